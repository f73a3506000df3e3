"""Progress for people: a bar on a terminal, plain lines elsewhere, always on standard error."""

import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import TextIO, cast

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, TaskID, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from lanewise.errors import one_line, printable

SURE = 0.03
"""Share of a stage before which no time is foretold: it may yet compile, for validations say."""


class Progress:
    """Reports how far the stages of a training have come, where that can be written.

    Use: ``with Progress() as progress: progress.stage("high level", 1000); progress.update(10)``.
    """

    def __init__(
        self,
        stream: TextIO | None = None,
        interval: float = 10.0,
        clock: Callable[[], float] = time.monotonic,
        quiet: bool = False,
        prefix: str = "",
    ) -> None:
        """Prepares a reporter.

        Args:
            stream: where to write; standard error by default.
            interval: least time between two plain lines, s.
            clock: tells the time, s.
            quiet: whether to write notes alone.
            prefix: begins every line, where several processes share a stream; there is no bar then.
        """
        self._stream = unfailing(sys.stderr if stream is None else stream)
        self._interval = interval
        self._clock = clock
        self._quiet = quiet
        self._prefix = prefix
        plain = quiet or prefix or not self._stream.isatty()
        self._bar = None if plain else _make_bar(self._stream)
        self._task: TaskID | None = None
        self._name = ""
        self._total = 0.0
        self._began: float | None = None
        self._first = self._last_line = 0.0

    def stage(self, name: str, total: float, done: float = 0.0) -> None:
        """Begins a stage that is complete at ``total``; a resumed one begins at ``done``."""
        if self._quiet:
            return
        # An experiment may call an arm anything.
        name = self._name = one_line(name)
        self._total, self._first = total, done
        self._began = None
        self._last_line = self._clock()
        if self._bar is not None:
            if self._task is not None:
                self._bar.stop_task(self._task)
            self._task = self._bar.add_task(
                escape(name), total=total, completed=int(done), metrics=""
            )
        else:
            self._line(f"{name}: {'continuing' if done else 'starting'}, compiling first")

    def update(self, done: float, **metrics: float) -> None:
        """Reports that ``done`` of the stage's total is complete, with a few figures."""
        if self._quiet:
            return
        figures = ", ".join(f"{k.replace('_', ' ')} {v:.4g}" for k, v in metrics.items())
        if self._bar is not None and self._task is not None:
            self._bar.update(self._task, completed=done, metrics=escape(figures))
            return
        now = self._clock()
        if self._began is None:
            # What came before includes compiling, which does not come again.
            self._began, self._first = now, done
        if done < self._total and now - self._last_line < self._interval:
            return
        self._last_line = now
        share = min(1.0, done / self._total) if self._total > 0 else 1.0
        left = self._time_left(done, now) if share >= SURE else ""
        parts = [f"{self._name}: {share:.0%}", left, figures]
        self._line(", ".join(part for part in parts if part))

    def note(self, text: str) -> None:
        """Writes a line that stays, such as a warning; control characters are spelled out."""
        text = printable(text)
        if self._bar is not None:
            self._bar.console.print(text, markup=False, highlight=False, soft_wrap=True)
        else:
            self._line(text)

    def __enter__(self) -> "Progress":
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def _time_left(self, done: float, now: float) -> str:
        if self._began is None or done <= self._first or done >= self._total:
            return ""
        seconds = (now - self._began) * (self._total - done) / (done - self._first)
        return f"{duration(seconds)} left"

    def _line(self, text: str) -> None:
        # Whole lines at once, so that two processes do not mix theirs.
        lines = text.splitlines() or [""]
        self._stream.write("".join(f"{self._prefix}{line}\n" for line in lines))
        self._stream.flush()


class UnfailingStream:
    """A text stream to which writing never fails.

    What reads it may go (`2>&1 | tee log`, and Ctrl-C ends both), a disk fill up, a terminal be
    closed: no reason to lose what the progress is about.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write it if that can be done."""
        with suppress(OSError):
            # What the stream's encoding lacks is spelled out.
            self._stream.write(text.encode(self.encoding, "backslashreplace").decode(self.encoding))
        return len(text)

    def flush(self) -> None:
        """Pass it on if that can be done."""
        with suppress(OSError):
            self._stream.flush()

    def isatty(self) -> bool:
        """Whether it is a terminal."""
        return self._stream.isatty()

    @property
    def encoding(self) -> str:
        """By which rich chooses the signs it draws bars with."""
        return getattr(self._stream, "encoding", None) or "utf-8"


def unfailing(stream: TextIO) -> TextIO:
    """The stream, made so that writing to it never fails."""
    return cast(TextIO, UnfailingStream(stream))


def tell(line: str) -> None:
    """Says on standard error how far a command is, if that can be written."""
    stream = unfailing(sys.stderr)
    stream.write(one_line(line) + "\n")
    stream.flush()


def _make_bar(stream: TextIO) -> Bar:
    return Bar(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f}%"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[metrics]}"),
        console=Console(file=stream),
        # Updates may be far apart; by default those older than 30 s do not count.
        speed_estimate_period=600.0,
    )


def duration(seconds: float) -> str:
    """A time for people: seconds, minutes, or hours and minutes."""
    if seconds < 60:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"
