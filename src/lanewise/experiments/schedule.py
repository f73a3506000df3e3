"""Runs the jobs of an experiment in processes of their own, as many at once as there are cores."""

import os
import signal
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from multiprocessing import active_children, connection, get_context, parent_process
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread
from typing import NoReturn, TextIO

from lanewise.errors import RunError
from lanewise.evaluation.concurrent import ONE_THREAD
from lanewise.experiments import jobs as job_list
from lanewise.experiments.jobs import Job
from lanewise.system import process
from lanewise.system.folder_io import OpenFolder
from lanewise.system.progress import Progress, duration, unfailing

COMPILED = "JAX_COMPILATION_CACHE_DIR"
"""Where JAX keeps compiled programs for other processes."""
Times = dict[str, float]


def run(jobs: Sequence[Job], processes: int, stream: TextIO, out: OpenFolder) -> Times:
    """Do every job that is not done in the experiment's folder, which this process holds.

    Returns:
        Seconds by part of the work.

    Raises:
        RunError: a process was killed, or found that the folder was moved, removed or replaced.
    """
    stream = unfailing(stream)
    left = [job for job in jobs if not job.done]
    if skipped := len(jobs) - len(left):
        stream.write(f"{skipped} of {len(jobs)} done before\n")
    times: Times = {}
    began, count = time.monotonic(), len(left)
    try:
        with (
            _environment(),
            _pool(min(processes, max(1, count))) as pool,
            process.handle_signal(signal.SIGTERM, _pass_on),
        ):
            for job, took in _completed(pool, left, processes, out):
                times |= took
                count -= 1
                share = 1 - count / len(left)
                remaining = (time.monotonic() - began) * (1 - share) / share
                after = f", about {duration(remaining)} left" if count else ""
                stream.write(f"[{len(left) - count}/{len(left)}] {job.label} done{after}\n")
                stream.flush()
    except BrokenProcessPool:
        raise RunError(
            "a process was killed, perhaps for want of memory; the same command continues"
        ) from None
    return times


def _completed(
    pool: ProcessPoolExecutor, jobs: Sequence[Job], processes: int, out: OpenFolder
) -> Iterator[tuple[Job, Times]]:
    """Jobs as they are completed; none begins before the run that lends it its step 1 is done."""
    waiting = list(jobs)
    busy: dict[Future[Times], Job] = {}
    while waiting or busy:
        unfinished = {job.path for job in (*waiting, *busy.values())}
        ready = [job for job in waiting if job.high_level not in unfinished]
        for job in ready[: processes - len(busy)]:
            waiting.remove(job)
            # With many jobs a line now and then from each is enough.
            interval = 10.0 if len(jobs) <= processes else 60.0
            busy[pool.submit(_work, job, interval, _ending(), out.path, out.status)] = job
        for future in wait(busy, return_when=FIRST_COMPLETED).done:
            yield busy.pop(future), future.result()


def _work(
    job: Job,
    interval: float,
    ending: Sequence[signal.Signals],
    out: Path,
    status: os.stat_result,
) -> Times:
    """A job, in a process of its own, with a line about it every so many seconds.

    The ``ending`` signals interrupt it; a process that waits for a job ignores them.
    """
    with (
        ExitStack() as handlers,
        Progress(interval=interval, prefix=f"[{job.label}] ") as reporter,
        OpenFolder.same(out, status) as folder,
    ):
        for number in ending:
            before = signal.signal(number, signal.default_int_handler)
            handlers.callback(signal.signal, number, before)
        return job_list.run(job, reporter, folder)


def _ending() -> tuple[signal.Signals, ...]:
    """Signals that end a job: not Ctrl-C where it is ignored, as in a shell's background."""
    ignored = signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    return (signal.SIGTERM,) if ignored else (signal.SIGTERM, signal.SIGINT)


def _pass_on(*_: object) -> NoReturn:
    """Do on SIGTERM, which reaches this process alone, what Ctrl-C does: it reaches them all."""
    for child in active_children():
        child.terminate()
    raise KeyboardInterrupt


@contextmanager
def _pool(processes: int) -> Iterator[ProcessPoolExecutor]:
    """Processes that begin afresh; after an error or a Ctrl-C nothing new is begun."""
    pool = ProcessPoolExecutor(processes, get_context("spawn"), initializer=_begin)
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def _begin() -> None:
    """In a process of the pool: ignore signals while it waits, and end when the parent is killed.

    A process that ended while it waits would break the pool, and end those at work before they
    have saved. One that outlived its parent would go on for the rest of its job, unseen, and keep
    the run folder from whoever starts the experiment again.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    parent = parent_process()
    assert parent is not None, "runs in processes of the pool alone"

    def watch() -> None:
        connection.wait([parent.sentinel])
        os._exit(1)

    Thread(target=watch, daemon=True).start()


@contextmanager
def _environment() -> Iterator[None]:
    """While processes start: their XLA computes on one thread, and they share what they compile.

    Seeds of one arm run the same programs. The user's own cache of compiled programs is respected.
    """
    before = dict(os.environ)
    with TemporaryDirectory(prefix="lanewise-compiled-") as compiled:
        os.environ["XLA_FLAGS"] = f"{before.get('XLA_FLAGS', '')} {ONE_THREAD}".strip()
        os.environ.setdefault(COMPILED, compiled)
        try:
            yield
        finally:
            for name in ("XLA_FLAGS", COMPILED):
                os.environ.pop(name)
                os.environ.update({name: before[name]} if name in before else {})
