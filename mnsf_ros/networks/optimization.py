# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The one Adam loop of the project: make a network's loss small, keep the best weights.

Losses are judged on the device that computes them, so that no step on CUDA waits for the host to
read a number; there the steps are recorded once as a graph and replayed.
"""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import TypeAlias

import torch
from torch import nn
from torch.optim.adam import adam

from mnsf_ros.core.flow_estimate import OptimizationResult, StopReason
from mnsf_ros.core.stage_clock import check_cancelled
from mnsf_ros.errors import OptimizationError

# Steps until the host asks whether the network has converged.
_STEPS_AT_ONCE = {"cpu": 1, "cuda": 10}
# Steps before the recording: a library may allocate at its first calls.
_UNRECORDED_STEPS = 3


@dataclass(frozen=True)
class Schedule:
    """Steps of the optimization of one network."""

    max_iterations: int
    learning_rate: float  # step size at the start
    decay: bool = False  # of the step size to zero, along a cosine
    patience: int = 0  # steps without improvement until it counts as converged; 0: any number
    min_delta_m: float = 0.0  # smallest decrease of the loss that is an improvement
    deadline: float = math.inf  # of `time.monotonic()`, after which no further step starts
    cancelled: Callable[[], bool] = lambda: False  # asked before each step
    records_steps: bool = True  # whether CUDA may record a step and replay it
    keep_best: bool = True  # whether to return to the weights of the lowest loss
    weight_decay: float = 0.0  # of Adam

    def learning_rate_at(self, iteration: int) -> float:
        """Step size of an iteration, counted from 0."""
        if not self.decay:
            return self.learning_rate
        return self.learning_rate * 0.5 * (1 + math.cos(math.pi * iteration / self.max_iterations))


# Computes the loss of a network as it is now, a scalar. Of two, the first one is minimized, and the
# other one decides when to stop.
LossOf: TypeAlias = Callable[[], torch.Tensor | tuple[torch.Tensor, torch.Tensor]]


def minimize(network: nn.Module, loss_of: LossOf, schedule: Schedule) -> OptimizationResult:
    """Optimizes a network, or a list of several, in place; one without weights stays as it is.

    `loss_of` must not read a value of the device.

    Raises:
        OptimizationError: If a loss is not finite and there are no better weights to return to.
        CancelledError: If `cancelled` of the schedule returns True.
    """
    weights = list(network.parameters())
    if not weights:
        loss, _ = _parts(loss_of())
        return OptimizationResult(_checked(loss.item()), 0, StopReason.CONVERGED)
    fit = _Fit(weights, loss_of, schedule)
    if fit.device.type == "cuda":
        with _recorder().on_its_stream():
            _take_steps(fit, schedule)
    else:
        _take_steps(fit, schedule)
    return fit.result()


def _take_steps(fit: "_Fit", schedule: Schedule) -> None:
    """Takes steps until the schedule or the loss ends it."""
    advance, is_on_cpu = fit.step, fit.device.type == "cpu"
    at_once = _STEPS_AT_ONCE[fit.device.type]
    while fit.num_steps < schedule.max_iterations:
        number = min(at_once, schedule.max_iterations - fit.num_steps)
        for _ in range(number):
            check_cancelled(schedule.cancelled)
            if fit.num_steps and time.monotonic() > schedule.deadline:
                fit.is_late = True
                return
            if fit.is_to_be_recorded:
                advance = _recorder().recorded(fit.step)
            advance()
            fit.num_steps += 1
        # The one place that waits for CUDA, and only where something depends on it.
        must_know = is_on_cpu or schedule.patience or schedule.deadline < math.inf
        if must_know and fit.has_stopped():
            return


class _Adam:
    """Adam on the weights of one fit, by a function of PyTorch.

    The class of PyTorch imports a compiler, which takes 75 MB of memory.
    """

    def __init__(self, weights: Sequence[torch.Tensor], weight_decay: float) -> None:
        self._weights, self._weight_decay = [*weights], weight_decay
        self._means, self._squares = ([torch.zeros_like(each) for each in weights] for _ in "12")
        self._num_steps = [torch.zeros((), device=each.device) for each in weights]

    @torch.no_grad()
    def step(self, gradients: Sequence[torch.Tensor], rate: torch.Tensor) -> None:
        """Takes a step along the gradients, one for each of the weights."""
        adam(
            self._weights,
            [_in_layout_of(*both) for both in zip(self._weights, gradients, strict=True)],
            self._means,
            self._squares,
            [],
            self._num_steps,
            # One pass over all weights; for networks this small that is a tenth of a step.
            fused=True,
            # On CUDA a step can be recorded.
            capturable=self._weights[0].is_cuda,
            amsgrad=False,
            beta1=0.9,
            beta2=0.999,
            lr=rate,
            weight_decay=self._weight_decay,
            eps=1e-8,
            maximize=False,
        )


class _Fit:
    """One optimization under way; its early stopping and best weights stay on its device."""

    def __init__(self, weights: list[nn.Parameter], loss_of: LossOf, schedule: Schedule) -> None:
        self._parameters, self._loss_of, self._schedule = weights, loss_of, schedule
        self.device = device = weights[0].device
        self._adam = _Adam(weights, schedule.weight_decay)
        self.num_steps = 0
        self.is_late = False
        # Adam on CUDA reads its step size as float32.
        precision = torch.float32 if device.type == "cuda" else torch.float64
        rates = [schedule.learning_rate_at(number) for number in range(schedule.max_iterations)]
        self._rates = torch.tensor(rates, device=device, dtype=precision)
        self._turn = torch.zeros(1, dtype=torch.int64, device=device)
        self._rate = torch.zeros((), device=device, dtype=precision)
        self._loss = torch.full((), math.nan, device=device).double()  # the last one
        self._best = torch.full_like(self._loss, math.inf)
        self._fallen_to = torch.full_like(self._loss, math.inf)
        self._num_waited = torch.zeros_like(self._loss, dtype=torch.int64)
        self._num_active = torch.zeros_like(self._loss, dtype=torch.int64)
        self._is_active = torch.ones_like(self._loss, dtype=torch.bool)
        self._kept = [parameter.detach().clone() for parameter in weights]

    @property
    def is_to_be_recorded(self) -> bool:
        """Whether the next steps are worth a recording."""
        is_first = self.num_steps == _UNRECORDED_STEPS
        is_long = self._schedule.max_iterations > 2 * _UNRECORDED_STEPS
        is_on_cuda = self.device.type == "cuda"
        return is_on_cuda and is_first and is_long and self._schedule.records_steps

    def step(self) -> None:
        """Computes the loss and takes one step. Only the device knows the value."""
        total, judged = _parts(self._loss_of())
        gradients = torch.autograd.grad(total, self._parameters)
        self._take_loss(total.detach().double())
        self._rate.copy_(self._rates.index_select(0, self._turn)[0])
        self._turn.add_(1)
        self._adam.step(gradients, self._rate)
        if self._schedule.patience:
            self._judge(judged.detach().double())

    @torch.no_grad()
    def _take_loss(self, loss: torch.Tensor) -> None:
        """Takes the loss of the weights before the step."""
        self._loss.copy_(torch.where(self._is_active, loss, self._loss))
        self._is_active.logical_and_(torch.isfinite(loss))
        if self._schedule.keep_best:
            is_better = self._is_active & (loss < self._best)
            self._best.copy_(torch.where(is_better, loss, self._best))
            self._keep(is_better)
        self._num_active.add_(self._is_active)

    @torch.no_grad()
    def _judge(self, loss: torch.Tensor) -> None:
        """Counts the steps without improvement of the loss from before the step."""
        if not self._schedule.keep_best:
            self._keep(self._is_active)
        has_fallen = loss < self._fallen_to - self._schedule.min_delta_m
        self._fallen_to.copy_(torch.where(has_fallen, loss, self._fallen_to))
        waited = torch.where(has_fallen, 0, self._num_waited + 1)
        self._num_waited.copy_(torch.where(self._is_active, waited, self._num_waited))
        self._is_active.logical_and_(self._num_waited < self._schedule.patience)

    def _keep(self, which: torch.Tensor) -> None:
        for kept, parameter in zip(self._kept, self._parameters, strict=True):
            kept.copy_(torch.where(which, parameter, kept))

    def has_stopped(self) -> bool:
        """Waits for the device; whether the network needs no other step."""
        return not bool(self._is_active)

    @torch.no_grad()
    def result(self) -> OptimizationResult:
        """The result; the network gets its final weights."""
        num_active = int(self._num_active)
        is_kept = num_active > 0 and (self._schedule.keep_best or self._schedule.patience > 0)
        for parameter, kept in zip(self._parameters, self._kept, strict=True):
            if is_kept:
                parameter.copy_(kept)
        last, best = self._loss.item(), self._best.item()
        loss_m = _checked(best if best < math.inf else last)
        return OptimizationResult(loss_m, num_active, self._stop_reason(last))

    def _stop_reason(self, last_loss: float) -> StopReason:
        if not math.isfinite(last_loss):
            return StopReason.NOT_FINITE
        if 0 < self._schedule.patience <= int(self._num_waited):
            return StopReason.CONVERGED
        return StopReason.TIME_BUDGET if self.is_late else StopReason.ITERATION_LIMIT


def _parts(
    loss: torch.Tensor | tuple[torch.Tensor, torch.Tensor],
) -> tuple[torch.Tensor, torch.Tensor]:
    """The loss to minimize, and the one to judge by."""
    return loss if isinstance(loss, tuple) else (loss, loss)


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
