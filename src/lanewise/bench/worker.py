"""Runs one workload in a process of its own. Standard library only.

``python worker.py FILE FUNCTION '{"argument": value}' CORE…`` calls the function, which prepares
(imports, compiles, warms up) and returns what is timed. It then prints `READY`, waits for a line,
calls what was returned and prints its result as JSON. So several workers can begin at the same
moment, and preparation is never timed. Lanewise need not be installed for the interpreter.
"""

import json
import os
import resource
import runpy  # noqa: TID251, a workload named by the table of benchmarks
import sys

READY = "ready"


def main() -> None:
    """Prepares, waits and measures."""
    file, function, arguments, *cores = sys.argv[1:]
    # As if the workload's file were the script.
    sys.path[0] = os.path.dirname(file)
    if cores and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {int(core) for core in cores})
    # Peers print what they like; only results may reach the parent.
    answers, sys.stdout = sys.stdout, sys.stderr
    timed = runpy.run_path(file, run_name="workload")[function](**json.loads(arguments))
    print(READY, file=answers, flush=True)
    if sys.stdin.readline():
        result = timed()
        result["detail"]["peak_memory_bytes"] = _peak_memory()
        print(json.dumps(result), file=answers, flush=True)


def _peak_memory() -> int:
    """The most bytes that this process, or one that it started, has had."""
    own, started = (
        # Linux counts in kibibytes.
        resource.getrusage(who).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
        for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    if os.path.exists("/proc/self/status"):
        # There the usage begins with what the parent had; this is the process's alone.
        with open("/proc/self/status") as status:
            own = int(status.read().split("VmHWM:")[1].split()[0]) * 1024
    return max(own, started)


if __name__ == "__main__":
    main()
