# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The one Adam loop of the project: make a network's loss small, keep the best weights.

Losses are judged on the device that computes them, so that no step on CUDA waits for the host to
read a number; there the steps are recorded once as a graph and replayed. Several networks in one
stack are optimized in the same steps, each with its own loss, best weights and end.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import cast

import torch

from mnsf_ros.core.batches import Batches, preload
from mnsf_ros.core.compute_device import copy_to
from mnsf_ros.core.flow_estimate import OptimizationResult, StopReason
from mnsf_ros.core.learner import Learner, LossOf, PartlyJudgedLoss
from mnsf_ros.core.schedule import Schedule
from mnsf_ros.errors import CancelledError, OptimizationError

# Steps until the host asks whether all networks have converged, and draws new batches.
_STEPS_AT_ONCE = {"cpu": 1, "cuda": 10}
# Steps before the recording: a library may allocate at its first calls.
_UNRECORDED_STEPS = 3


def minimize(
    learner: Learner,
    loss_of: LossOf,
    schedule: Schedule,
    *,
    keep_best: bool,
    sources: Sequence[Batches] = (),
) -> OptimizationResult:
    """Optimizes one network in place, see `minimize_stack`. One without weights stays as it is."""
    if learner.optimizer is None:
        loss, _ = _parts(loss_of())
        return OptimizationResult(_checked(loss.item()), 0, StopReason.CONVERGED)
    (result,) = minimize_stack(learner, loss_of, schedule, keep_best=keep_best, sources=sources)
    return result


def minimize_stack(
    learner: Learner,
    losses_of: LossOf,
    schedule: Schedule,
    *,
    keep_best: bool,
    sources: Sequence[Batches] = (),
) -> list[OptimizationResult]:
    """Optimizes the networks of a learner in place.

    Args:
        learner: One network, or a stack of K. Gets the final loss of the first as `last_loss`.
        losses_of: Computes the current loss of each network, (K,), or one scalar, as a rule in
            metres. It must not read a value of the device.
        schedule: Number and size of the steps, and when to stop.
        keep_best: Whether to return to the weights of the lowest loss. Meaningful only if
            `losses_of` computes the same thing at each call, not for random batches.
        sources: The batches that `losses_of` draws from, in the order of drawing.

    Returns:
        The result of each network.

    Raises:
        OptimizationError: If a loss is not finite and there are no better weights to return to.
        CancelledError: If the schedule's `cancelled` says so.
    """
    fit = _Fit(learner, losses_of, schedule, keep_best=keep_best)
    try:
        if fit.device.type == "cuda":
            with _recorder().on_its_stream():
                _take_steps(fit, schedule, sources)
        else:
            _take_steps(fit, schedule, sources)
    finally:
        for source in sources:
            source.unload()
    results = fit.results()
    learner.last_loss = results[0].loss_m
    return results


def _take_steps(fit: _Fit, schedule: Schedule, sources: Sequence[Batches]) -> None:
    """Takes steps until the schedule or all losses end it."""
    advance, is_on_cpu = fit.step, fit.device.type == "cpu"
    at_once = _STEPS_AT_ONCE[fit.device.type]
    while fit.num_steps < schedule.max_iterations:
        number = min(at_once, schedule.max_iterations - fit.num_steps)
        preload(sources, number, at_once)
        fit.load_rates(number)
        for _ in range(number):
            if schedule.cancelled():
                raise CancelledError("the estimate was cancelled")
            if fit.num_steps and time.monotonic() > schedule.deadline:
                fit.is_late = True
                return
            if fit.is_to_be_recorded:
                advance = _recorder().recorded(fit.step)
            advance()
            fit.num_steps += 1
        # The one place that waits for CUDA, and only where something depends on it.
        must_know = is_on_cpu or schedule.patience or schedule.deadline < math.inf
        if must_know and fit.have_all_stopped():
            return


class _Fit:
    """One optimization under way."""

    def __init__(
        self, learner: Learner, losses_of: LossOf, schedule: Schedule, *, keep_best: bool
    ) -> None:
        # A network without weights is never optimized.
        self._optimizer = cast(torch.optim.Adam, learner.optimizer)
        self._losses_of = losses_of
        self._schedule = schedule
        self._parameters = list(learner.network.parameters())
        self.device = device = self._parameters[0].device
        self.num_steps = 0
        self.is_late = False
        # Adam on CUDA reads its step size as float32.
        precision = torch.float32 if device.type == "cuda" else torch.float64
        self._rates = torch.zeros(_STEPS_AT_ONCE[device.type], device=device, dtype=precision)
        self._turn = torch.zeros(1, dtype=torch.int64, device=device)
        self._rate = torch.zeros((), device=device, dtype=precision)
        self._losses = torch.full((learner.num_networks,), math.nan, device=device).double()
        self._judge = (
            _Judge(self._parameters, self._losses, schedule, keep_best=keep_best)
            if keep_best or schedule.patience
            else None
        )

    @property
    def is_to_be_recorded(self) -> bool:
        """Whether the next steps are worth a recording."""
        is_first = self.num_steps == _UNRECORDED_STEPS
        is_long = self._schedule.max_iterations > 2 * _UNRECORDED_STEPS
        is_on_cuda = self.device.type == "cuda"
        return is_on_cuda and is_first and is_long and self._schedule.records_steps

    def load_rates(self, number: int) -> None:
        """Puts the sizes of the next steps where `step` finds them."""
        rates = [self._schedule.learning_rate_at(self.num_steps + k) for k in range(number)]
        copy_to(self._rates[:number], torch.tensor(rates, dtype=self._rates.dtype))
        self._turn.zero_()

    def step(self) -> None:
        """Computes the losses and takes one step. Only the device knows the values."""
        total, judged = _parts(self._losses_of())
        gradients = torch.autograd.grad(total.sum(), self._parameters)
        own = total.detach().reshape(-1).double()
        if self._judge is None:
            self._losses.copy_(own)
        else:
            self._judge.before_step(own)
        self._rate.copy_(self._rates.index_select(0, self._turn)[0])
        self._turn.add_(1)
        for group in self._optimizer.param_groups:
            group["lr"] = self._rate
        for parameter, gradient in zip(self._parameters, gradients, strict=True):
            parameter.grad = _in_layout_of(parameter, gradient)
        self._optimizer.step()
        if self._judge is not None:
            self._judge.after_step(judged.detach().reshape(-1).double())

    def have_all_stopped(self) -> bool:
        """Waits for the device; whether no network needs another step."""
        return self._judge is not None and not bool(self._judge.is_active.any())

    def results(self) -> list[OptimizationResult]:
        """The result of each network, which gets its final weights."""
        for parameter in self._parameters:
            parameter.grad = None
        end = StopReason.TIME_BUDGET if self.is_late else StopReason.ITERATION_LIMIT
        if self._judge is not None:
            return self._judge.results(end)
        losses = self._losses.tolist()
        return [OptimizationResult(_checked(loss), self.num_steps, end) for loss in losses]


class _Judge:
    """Early stopping and the best weights of K networks, on their device."""

    def __init__(
        self,
        parameters: Sequence[torch.Tensor],
        losses: torch.Tensor,
        schedule: Schedule,
        *,
        keep_best: bool,
    ) -> None:
        self._parameters = parameters
        self._losses = losses  # [K], the last ones
        self._schedule = schedule
        self._keeps_best = keep_best
        self._best = torch.full_like(losses, math.inf)
        self._fallen_to = torch.full_like(losses, math.inf)
        self._num_waited = torch.zeros_like(losses, dtype=torch.int64)
        self._num_steps = torch.zeros_like(losses, dtype=torch.int64)
        self._kept = [parameter.detach().clone() for parameter in parameters]
        self.is_active = torch.ones_like(losses, dtype=torch.bool)

    @torch.no_grad()
    def before_step(self, losses: torch.Tensor) -> None:
        """Takes the losses (K,) of the current weights."""
        self._losses.copy_(torch.where(self.is_active, losses, self._losses))
        self.is_active.logical_and_(torch.isfinite(losses))
        if self._keeps_best:
            is_better = self.is_active & (losses < self._best)
            self._best.copy_(torch.where(is_better, losses, self._best))
            self._keep(is_better)
        self._num_steps.add_(self.is_active)

    @torch.no_grad()
    def after_step(self, judged: torch.Tensor) -> None:
        """Counts the steps without improvement of the losses (K,) from before the step."""
        if not self._schedule.patience:
            return
        if not self._keeps_best:
            self._keep(self.is_active)
        has_fallen = judged < self._fallen_to - self._schedule.min_delta_m
        self._fallen_to.copy_(torch.where(has_fallen, judged, self._fallen_to))
        waited = torch.where(has_fallen, 0, self._num_waited + 1)
        self._num_waited.copy_(torch.where(self.is_active, waited, self._num_waited))
        self.is_active.logical_and_(self._num_waited < self._schedule.patience)

    def _keep(self, which: torch.Tensor) -> None:
        for kept, parameter in zip(self._kept, self._parameters, strict=True):
            kept.copy_(torch.where(_like(which, kept), parameter, kept))

    @torch.no_grad()
    def results(self, end: StopReason) -> list[OptimizationResult]:
        """The result of each network; puts the kept weights into the networks."""
        has_kept = self._num_steps > 0
        for parameter, kept in zip(self._parameters, self._kept, strict=True):
            parameter.copy_(torch.where(_like(has_kept, kept), kept, parameter))
        known = (self._losses, self._best, self._num_steps.double(), self._num_waited.double())
        return [
            OptimizationResult(
                _checked(best if best < math.inf else last),
                int(number),
                self._reason(last, int(waited), end),
            )
            for last, best, number, waited in torch.stack(known, dim=1).tolist()
        ]

    def _reason(self, last: float, num_waited: int, end: StopReason) -> StopReason:
        if not math.isfinite(last):
            return StopReason.NOT_FINITE
        has_converged = 0 < self._schedule.patience <= num_waited
        return StopReason.CONVERGED if has_converged else end


def _parts(loss: torch.Tensor | PartlyJudgedLoss) -> tuple[torch.Tensor, torch.Tensor]:
    """The loss to minimize, and the one to judge by."""
    return (loss.total, loss.judged) if isinstance(loss, PartlyJudgedLoss) else (loss, loss)


def _checked(loss: float) -> float:
    """Returns the final loss, or raises OptimizationError if it is not finite."""
    if not math.isfinite(loss):
        raise OptimizationError(f"the loss became {loss}, expected a finite number of metres")
    return loss


def _in_layout_of(parameter: torch.Tensor, gradient: torch.Tensor) -> torch.Tensor:
    """The gradient with the strides of its parameter: fused Adam reads both in order of memory."""
    if gradient.stride() == parameter.stride():
        return gradient
    return torch.empty_like(parameter).copy_(gradient)


def _like(which: torch.Tensor, weights: torch.Tensor) -> torch.Tensor:
    """One value for each network (K,), in the shape of weights that begins with K."""
    return which.view(-1, *(1,) * (weights.ndim - 1))


class _Recorder:
    """Records steps as CUDA graphs that share their memory and one stream."""

    def __init__(self) -> None:
        self._stream = torch.cuda.Stream()
        self._memory = torch.cuda.graph_pool_handle()
        self._last: torch.cuda.CUDAGraph | None = None

    @contextmanager
    def on_its_stream(self) -> Iterator[None]:
        """Runs the block's work after all earlier work, and before all later."""
        self._stream.wait_stream(torch.cuda.current_stream())
        try:
            with torch.cuda.stream(self._stream):
                yield
        finally:
            torch.cuda.current_stream().wait_stream(self._stream)

    def recorded(self, step: Callable[[], None]) -> Callable[[], None]:
        """Records a step, without taking it, and returns its replay."""
        graph = torch.cuda.CUDAGraph()
        # Not `torch.cuda.graph`, which collects garbage and gives back all memory each time.
        graph.capture_begin(pool=self._memory, capture_error_mode="thread_local")
        try:
            step()
        finally:
            graph.capture_end()
        # The shared memory lives as long as one graph that has it.
        self._last = graph
        return graph.replay


@cache
def _recorder() -> _Recorder:
    return _Recorder()
