"""Runs one worker in the interpreter that is given this file. Standard library only.

``python runner.py WORKER.py '{"argument": value}' CORE…``: calls the worker's ``prepare``, says
that it is ready, waits for a line, then calls what ``prepare`` returned and prints its result as
JSON. So several can begin at the same moment, and preparing (imports, compilation) is never
counted. The interpreter may be one in which Lanewise is not installed: a peer is measured where it
lives.
"""

import json
import os
import resource
import runpy
import sys
from typing import Any

READY = "ready"


def main() -> None:
    """Prepares, waits and measures."""
    worker, arguments, *cores = sys.argv[1:]
    # The modules beside this one are Lanewise's; here they would only hide others of their names.
    sys.path[:] = [place for place in sys.path if place != os.path.dirname(__file__)]
    if cores and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {int(core) for core in cores})
    # Peers print what they like; only results may reach the one who asked.
    answers, sys.stdout = sys.stdout, sys.stderr
    # Under the name it has in the package, for whoever traces or profiles it.
    name = f"lanewise.bench.workers.{os.path.basename(worker).removesuffix('.py')}"
    measure = runpy.run_path(worker, run_name=name)["prepare"](**json.loads(arguments))
    print(READY, file=answers, flush=True)
    if not sys.stdin.readline():
        return
    result: dict[str, Any] = measure()
    result["peak_memory_bytes"] = peak_memory(resource.getrusage(resource.RUSAGE_SELF))
    print(json.dumps(result), file=answers, flush=True)


def peak_memory(usage: resource.struct_rusage) -> int:
    """The most memory a process has had, in bytes; Linux counts in kibibytes."""
    return usage.ru_maxrss if sys.platform == "darwin" else usage.ru_maxrss * 1024


if __name__ == "__main__":
    main()
