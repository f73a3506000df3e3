"""Tests in processes forked from one that has imported the heavy packages already.

A campaign of a hundred faults starts pytest a hundred times; importing JAX and its friends would
be most of each. Lanewise itself is imported by the forked process alone, so that it is the
altered one. Reads one request a line and answers with one line, both JSON:

    {"tests": [...], "seconds": 60, "log": "file"}
    {"outcome": "passed" | "failed" | "timed out" | "broken", "failed": "test", "seconds": 3.2}
"""

import importlib
import json
import os
import signal
import sys
import time
import warnings
from contextlib import suppress
from pathlib import Path

OPTIONS = ("-o", "addopts=", "-q", "-x", "-p", "no:cacheprovider", "-p", "no:xdist", "--tb=short")
"""One process, no marker left out, over at the first failure, nothing remembered."""
FAILED = (1, 2)
"""pytest's exit codes for a failed test and for one that cannot even be collected."""


class FirstFailure:
    """Remembers the first test that failed."""

    def __init__(self, path):
        self.path = path

    def note(self, report):
        if report.failed and not self.path.exists():
            self.path.write_text(report.nodeid)

    pytest_runtest_logreport = note
    pytest_collectreport = note


def run_tests(tests, log, failure):
    """The forked process: never returns."""
    import pytest

    os.setsid()
    descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    for stream in (1, 2):
        os.dup2(descriptor, stream)
    code = pytest.main([*OPTIONS, *tests], plugins=[FirstFailure(failure)])
    sys.stdout.flush()
    os._exit(int(code))


def wait(child, seconds):
    """Exit code of a child, None if it had to be ended."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.05)
    return None


def answer(request):
    """Run the tests of a request, and say how it went."""
    log, began = Path(request["log"]), time.monotonic()
    failure = log.with_suffix(".failed")
    failure.unlink(missing_ok=True)
    child = os.fork()
    if not child:
        # Whatever happens here must not come back as a second server.
        try:
            run_tests(request["tests"], log, failure)
        finally:
            os._exit(70)
    code = wait(child, request["seconds"])
    # The child leads a group of its own; with it goes whatever its tests have started.
    with suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    if code is None:
        with suppress(ChildProcessError):
            os.waitpid(child, 0)
    failed = failure.read_text() if failure.exists() else ""
    if code is None:
        outcome = "timed out"
    elif code == 0:
        outcome = "passed"
    else:
        outcome = "failed" if code in FAILED and failed else "broken"
    return {"outcome": outcome, "failed": failed, "seconds": round(time.monotonic() - began, 1)}


def main():
    """Import what was asked for, then serve."""
    for name in sys.argv[1:]:
        importlib.import_module(name)
    # JAX warns of forks, as its threads would not follow; it starts none before its first use.
    warnings.filterwarnings("ignore", message=r".*os\.fork\(\)")
    for line in sys.stdin:
        print(json.dumps(answer(json.loads(line))), flush=True)


if __name__ == "__main__":
    main()
