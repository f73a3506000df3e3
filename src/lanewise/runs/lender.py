"""Runs that lend their high level to others. Imports no JAX."""

import os
from pathlib import Path

from lanewise.config import validation
from lanewise.config.settings import Settings
from lanewise.controllers.registry import STEP_1
from lanewise.errors import RunError, SettingsError
from lanewise.runs.folder import RunFolder


def check_lender(source: Path, settings: Settings, parts: tuple[str, ...] = ()) -> RunFolder:
    """The run at ``source``, once it is sure that its high level fits these settings.

    Args:
        source: of the run.
        settings: of the borrower.
        parts: names of the user's own functions it is trained with.

    Raises:
        RunError: it has no finished step 1, or the two high levels differ in shape or in what
            they see, or it was trained with other parts.
    """
    lender = RunFolder.open(source)
    if not os.path.lexists(lender.stages / f"{STEP_1.name}.json"):
        raise RunError(f"{source} has no finished {STEP_1.name}: it cannot lend its high level")
    lender.check_parts(parts)
    try:
        validation.check_high_level(lender.settings, settings)
    except SettingsError as error:
        raise RunError(f"{source} {error}") from error
    return lender
