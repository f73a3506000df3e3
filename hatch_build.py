"""Leaves the commit in a built package, so that its results can say which code made them."""

import json
import runpy  # noqa: TID251, our own file
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CommitHook(BuildHookInterface):
    """Adds `lanewise/commit.json` to wheels built from a checkout; editable installs ask git."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Write the file and have it included."""
        root = Path(self.root)
        if version == "editable" or not (root / ".git").exists():
            return
        code = runpy.run_path(str(root / "src" / "lanewise" / "system" / "version.py"))
        self._place = TemporaryDirectory()
        file = Path(self._place.name) / code["BUILT_FROM"]
        file.write_text(json.dumps(code["checkout_commit"](root)) + "\n", "utf-8")
        build_data["force_include"][str(file)] = f"lanewise/{file.name}"
