"""A pytest plugin: some tests, in an order of their own, and what became of each.

Files are shuffled, and the tests within each; a file's tests stay together, as its fixtures may
train controllers. Used by `shuffled.py`.
"""

import json
import os
import random
from pathlib import Path

import pytest


def pytest_addoption(parser):
    """Where to read and write."""
    group = parser.getgroup("shuffle")
    group.addoption("--shuffle-seed", type=int, help="of the order; as written without")
    group.addoption("--shuffle-only", help="JSON file: list of tests, parameters left out")
    group.addoption("--shuffle-report", help="JSON file to write: outcome and CPU s of each test")


def pytest_configure(config):
    """Take part only where asked to."""
    if config.getoption("--shuffle-report"):
        config.pluginmanager.register(Shuffle(config), "shuffle")


def spent():
    """CPU time of this process and of those it has waited for, s."""
    return sum(os.times()[:4])


class Shuffle:
    """One session."""

    def __init__(self, config):
        self.seed = config.getoption("--shuffle-seed")
        self.only = set(json.loads(Path(config.getoption("--shuffle-only")).read_text()))
        self.report = Path(config.getoption("--shuffle-report")).resolve()
        self.tests = {}

    # First, so that pytest can still bring those together that share a costly parameter.
    @pytest.hookimpl(tryfirst=True)
    def pytest_collection_modifyitems(self, config, items):
        files = {}
        for item in items:
            if item.nodeid.split("[")[0] in self.only:
                files.setdefault(item.path, []).append(item)
        groups = list(files.values())
        if self.seed is not None:
            order = random.Random(self.seed)
            order.shuffle(groups)
            for group in groups:
                order.shuffle(group)
        chosen = [item for group in groups for item in group]
        config.hook.pytest_deselected(items=[item for item in items if item not in set(chosen)])
        items[:] = chosen

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item):
        began = spent()
        result = yield
        self.tests.setdefault(item.nodeid, {})["seconds"] = round(spent() - began, 3)
        return result

    def pytest_runtest_logreport(self, report):
        known = self.tests.setdefault(report.nodeid, {"failed": False})
        known["failed"] = known.get("failed", False) or report.failed

    def pytest_sessionfinish(self):
        self.report.write_text(json.dumps(self.tests))
