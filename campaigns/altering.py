"""Ways to alter a file, as accidents and strangers do; each takes (rng, file, other), changes it.

``other`` is a file of the same kind that belongs elsewhere. `forging` has the ways of somebody who
makes the digests right again.
"""

import os

HUGE = 12 * 1024**3


def flip(rng, file, other):
    """One bit, or a few."""
    data = bytearray(file.read_bytes())
    for place in rng.integers(0, len(data), rng.choice([1, 1, 1, 4])):
        data[place] ^= 1 << int(rng.integers(0, 8))
    file.write_bytes(data)


def truncate(rng, file, other):
    """Cut short anywhere."""
    data = file.read_bytes()
    file.write_bytes(data[: int(rng.integers(0, len(data)))])


def extend(rng, file, other):
    """Something behind the end."""
    more = [b"\0" * 64, b"{}\n", b"]", rng.bytes(50), b"\xff\xfe"]
    file.write_bytes(file.read_bytes() + more[rng.integers(len(more))])


def swap_blocks(rng, file, other):
    """Two parts change places."""
    data = file.read_bytes()
    a, b, c = sorted(int(place) for place in rng.integers(0, len(data) + 1, 3))
    file.write_bytes(data[:a] + data[b:c] + data[a:b] + data[c:])


def drop_block(rng, file, other):
    """A part is gone."""
    data = file.read_bytes()
    a, b = sorted(int(place) for place in rng.integers(0, len(data) + 1, 2))
    file.write_bytes(data[:a] + data[b:])


def overwrite(rng, file, other):
    """A part is noise."""
    data = bytearray(file.read_bytes())
    a, b = sorted(int(place) for place in rng.integers(0, len(data) + 1, 2))
    data[a : min(b, a + 64)] = rng.bytes(min(b, a + 64) - a)
    file.write_bytes(data)


def mix(rng, file, other):
    """The beginning of one file with the end of another."""
    ours, theirs = file.read_bytes(), other.read_bytes()
    place = int(rng.integers(0, min(len(ours), len(theirs)) + 1))
    file.write_bytes(ours[:place] + theirs[place:])


def exchange(rng, file, other):
    """The file of another run."""
    file.write_bytes(other.read_bytes())


def noise(rng, file, other):
    """Nothing of it is left."""
    file.write_bytes(rng.bytes(int(rng.integers(1, 4000))))


def sparse(rng, file, other):
    """A file that says it is larger than any memory, and takes no room."""
    os.truncate(file, int(rng.choice([HUGE, HUGE // 4, 70_000_000])))


def endless(rng, file, other):
    """A link to a device that never ends."""
    file.unlink()
    file.symlink_to("/dev/zero")


def pipe(rng, file, other):
    """A pipe that nobody writes to."""
    file.unlink()
    os.mkfifo(file)


def folder(rng, file, other):
    """A folder of that name."""
    file.unlink()
    file.mkdir()


def missing(rng, file, other):
    """Nothing of that name."""
    file.unlink()


def loop(rng, file, other):
    """A link to itself, or to nothing."""
    file.unlink()
    file.symlink_to(file if rng.integers(2) else file.with_name("nowhere"))


def link(rng, file, other):
    """A link to a file that is as it should be."""
    kept = file.with_name(f"{file.name}.kept")
    file.rename(kept)
    file.symlink_to(kept)


def deep(rng, file, other):
    """Lists in lists in lists."""
    depth = int(rng.choice([40, 900, 20_000]))
    opening, closing = [("[", "]"), ('{"a":', "}")][rng.integers(2)]
    inner = "1" if opening != "[" else ""
    text = opening * depth + inner + closing * depth
    head = "" if file.suffix in (".json", ".jsonl") else "a = "
    file.write_text(head + text.replace(":", "=" if head else ":") + "\n")


def many(rng, file, other):
    """Very many small things, as many as the size allows."""
    words = ['{"a":[],"b":{}},', "[],", '"",', "0,"]
    word = words[rng.integers(len(words))]
    size = int(rng.choice([99_000, 990_000]))
    head = "" if file.suffix in (".json", ".jsonl") else "a = "
    file.write_text(f"{head}[{word * (size // len(word))}0]\n")


def dotted(rng, file, other):
    """A name of endless parts, or an endless name."""
    count = int(rng.integers(1000, 45_000))
    text = [".".join("a" * count), "a" * count, '"\\u001b[2J"', "a" * 90][rng.integers(4)]
    file.write_text(f"{text} = 1\n")


def not_finite(rng, file, other):
    """A number becomes NaN, infinity, or one of endless digits."""
    data = file.read_bytes()
    digits = [place for place, byte in enumerate(data) if 48 <= byte < 58]
    if digits:
        place = digits[rng.integers(len(digits))]
        words = [b"NaN", b"-Infinity", b"nan", b"inf", b"1e999", b"9" * 5000, b"1e-9999999"]
        data = data[:place] + words[rng.integers(len(words))] + data[place + 1 :]
    file.write_bytes(data)


def twice(rng, file, other):
    """A line, or the first field, stands there twice."""
    lines = file.read_bytes().splitlines(keepends=True)
    place = int(rng.integers(len(lines)))
    file.write_bytes(b"".join([*lines[: place + 1], *lines[place:]]))


def recoded(rng, file, other):
    """The same text in another encoding."""
    text = file.read_bytes().decode("utf-8")
    file.write_bytes(text.encode(["utf-16", "utf-32", "utf-8-sig"][rng.integers(3)]))


BYTES = (
    *(flip, truncate, extend, swap_blocks, drop_block, overwrite, mix, exchange, noise, sparse),
    *(endless, pipe, folder, missing, loop, link),
)
"""For any file."""
TEXT = (deep, many, not_finite, twice, recoded)
"""For JSON and TOML."""
