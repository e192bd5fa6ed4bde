"""When a fit has converged: no improvement for a number of iterations."""

from __future__ import annotations

import math


class EarlyStopping:
    """Counts the iterations since the loss last fell by a minimum."""

    def __init__(self, patience: int, min_delta_m: float) -> None:
        """Sets the rule.

        Args:
            patience: Iterations without improvement that are borne; 0 turns the rule off.
            min_delta_m: A smaller fall of the loss is no improvement.
        """
        self._patience = patience
        self._min_delta_m = min_delta_m
        self._best = math.inf
        self._num_without_improvement = 0

    @property
    def is_on(self) -> bool:
        """False if this rule never stops anything; the loss then need not be known."""
        return self._patience > 0

    def should_stop(self, loss: float) -> bool:
        """Takes the loss of one more iteration and says whether to stop."""
        if loss < self._best - self._min_delta_m:
            self._best = loss
            self._num_without_improvement = 0
        else:
            self._num_without_improvement += 1
        return self.is_on and self._num_without_improvement >= self._patience
