# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The console of all subcommands."""

from __future__ import annotations

import os
import sys

import rich.console


class Console(rich.console.Console):
    """Falls silent when its reader has left, as after `| head -1`; the work goes on."""

    def say(self, text: str, style: str | None = None, *, soft_wrap: bool = False) -> None:
        """Prints a text without markup; with `soft_wrap`, long lines stay whole."""
        self.print(text, style=style, markup=False, highlight=False, soft_wrap=soft_wrap)

    def warn(self, text: str) -> None:
        """Prints a text that needs attention."""
        self.say(text, "yellow")

    def on_broken_pipe(self) -> None:
        """Falls silent, where rich would end the process."""
        self.quiet = True
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)

    def _check_buffer(self) -> None:
        """Writes; rich before 13.8 (Ubuntu 24.04) does not call `on_broken_pipe` itself."""
        try:
            super()._check_buffer()
        except BrokenPipeError:
            self.on_broken_pipe()
        except OSError as error:
            print(f"mnsf: the output cannot be written: {error.strerror}", file=sys.stderr)
            self.on_broken_pipe()
