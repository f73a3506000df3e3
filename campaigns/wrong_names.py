"""Misspelt names, made from the right ones. Nothing here knows how Lanewise looks for them."""

import string

NEIGHBOURS = {
    letter: row[max(0, place - 1) : place] + row[place + 1 : place + 2]
    for row in ("qwertyuiop", "asdfghjkl", "zxcvbnm")
    for place, letter in enumerate(row)
}
"""Letters beside each other on a keyboard."""
SPELLINGS = (
    *(("centring", "centering"), ("tolerance", "tolerence"), ("braking", "breaking")),
    *(("acceleration", "accelleration"), ("deceleration", "decceleration")),
    *(("observation", "observasion"), ("evaluation", "evalution"), ("renewal", "renewel")),
)
"""Words that are spelt in another way, across the ocean or by ear."""


def _letters(name):
    return [place for place, letter in enumerate(name) if letter in string.ascii_letters]


def dropped(rng, name):
    """One letter less."""
    place = rng.choice(_letters(name))
    return name[:place] + name[place + 1 :]


def doubled(rng, name):
    """One letter twice."""
    place = rng.choice(_letters(name))
    return name[:place] + name[place] + name[place:]


def swapped(rng, name):
    """Two letters that stand side by side the wrong way round."""
    pairs = [p for p in _letters(name)[:-1] if name[p + 1].isalpha() and name[p] != name[p + 1]]
    place = rng.choice(pairs)
    return name[:place] + name[place + 1] + name[place] + name[place + 2 :]


def neighbour(rng, name):
    """A key beside the right one."""
    place = rng.choice([place for place in _letters(name) if name[place].lower() in NEIGHBOURS])
    return name[:place] + rng.choice(NEIGHBOURS[name[place].lower()]) + name[place + 1 :]


def two_slips(rng, name):
    """Two of these at once."""
    first, second = rng.sample([dropped, doubled, swapped, neighbour], 2)
    return second(rng, first(rng, name))


def upper(rng, name):
    """In capitals."""
    return name.upper()


def camel(rng, name):
    """In the manner of other languages: speedLimit."""
    head, *rest = name.split("_")
    return head + "".join(word.capitalize() for word in rest)


def number(rng, name):
    """Singular for plural, or the other way round."""
    return name[:-1] if name.endswith("s") else name + "s"


def reordered(rng, name):
    """The words of the last name the other way round."""
    owner, dot, leaf = name.rpartition(".")
    return owner + dot + "_".join(reversed(leaf.split("_")))


def run_together(rng, name):
    """The words of the last name without anything between them."""
    owner, dot, leaf = name.rpartition(".")
    return owner + dot + leaf.replace("_", "")


def separator(rng, name):
    """Something else than a dot between the sections."""
    return name.replace(".", rng.choice(["/", ":", "__", "_", " "]))


def spelling(rng, name):
    """Spelt in another way."""
    for ours, theirs in SPELLINGS:
        name = name.replace(ours, theirs)
    return name


def no_section(rng, name):
    """The last name alone."""
    return name.rpartition(".")[2]


def no_inner_section(rng, name):
    """The first section and the last name."""
    words = name.split(".")
    return f"{words[0]}.{words[-1]}"


def no_section_and_slip(rng, name):
    """The last name alone, and that misspelt."""
    return rng.choice([dropped, doubled, swapped, neighbour])(rng, no_section(rng, name))


def wrong_section(rng, name, sections):
    """In another section."""
    owner, _, leaf = name.rpartition(".")
    return f"{rng.choice([section for section in sections if section != owner])}.{leaf}"


SLIPS = (dropped, doubled, swapped, neighbour, two_slips, upper, number)
"""Of any name."""
SETTING_SLIPS = (
    *(*SLIPS, camel, reordered, run_together, separator, spelling),
    *(no_section, no_inner_section, no_section_and_slip),
)
"""Of a setting with its sections; `wrong_section` besides."""
