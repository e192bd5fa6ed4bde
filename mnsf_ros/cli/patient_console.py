"""A console whose reader may leave: what is being done goes on without it."""

from __future__ import annotations

import os
import sys

from rich.console import Console


class PatientConsole(Console):
    """Prints to the standard output until nobody reads it any more, as after `| head -1`."""

    def on_broken_pipe(self) -> None:
        """Prints nothing from now on, where rich would end the process."""
        self.quiet = True
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)

    def _check_buffer(self) -> None:
        """Writes; versions of rich before 13.8, as Ubuntu 24.04 has, do not ask what to do then."""
        try:
            super()._check_buffer()
        except BrokenPipeError:
            self.on_broken_pipe()
        except OSError as error:
            print(f"mnsf: the output cannot be written: {error.strerror}", file=sys.stderr)
            self.on_broken_pipe()
