"""Both ways take turns, and the ratio is that of their rates."""

import costs


def test_turns_and_ratios():
    asked, told = [], []
    rates = {"ours": iter([90.0, 80.0, 99.0]), "without": iter([100.0, 100.0, 100.0])}

    def measure(name):
        def once():
            asked.append(name)
            return next(rates[name])

        return once

    found = costs.compared(measure("ours"), measure("without"), 3, told.append)
    assert (found["ratio"], found["least"], found["most"]) == (0.9, 0.8, 0.99)
    assert (found["ours"], found["without"], found["turns"]) == (90.0, 100.0, 3)
    # Neither is always the first.
    assert asked == ["without", "ours", "ours", "without", "without", "ours"]
    assert told == [1, 2, 3]
