"""`mnsf evaluate`: scores methods on recordings."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from mnsf_ros.cli.arguments import add_setting_arguments, parse_assignments
from mnsf_ros.errors import SettingsError
from mnsf_ros.presets import preset

EXIT_INCOMPLETE = 3
EXIT_UNWRITTEN = 4
DEFAULT_METHODS = "online,mnsf"
_ALL_POINTS = "all"

_EPILOG = """\
Examples:
  mnsf simulate street
  mnsf evaluate street
  mnsf evaluate street --methods zero,online --preset online --realtime 1 --out results

Exit status:
  0    complete
  2    an argument, setting or recording cannot be used; nothing was run
  3    done, but incomplete: a recording is damaged (its readable part was
       evaluated) or has nothing to evaluate, a task failed, a method failed on
       every example of a recording, or report.html could not be written
  4    stopped: results cannot be written, for example because the disk is full
  130  interrupted

After 4 and 130, finished results are kept. To continue, repeat the command
with --out and --resume.
"""


def add_to(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds the subcommand."""
    parser = subparsers.add_parser(
        "evaluate",
        help="score methods on recordings",
        description="Estimates scene flow on whole recordings, scores it, prints tables and "
        "writes a report.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("bags", nargs="+", type=Path, metavar="BAG", help="recordings")
    topics = parser.add_argument_group("topics (the same for all recordings)")
    topics.add_argument(
        "--points",
        metavar="TOPIC",
        help="point clouds (needed only if a recording has several such topics)",
    )
    topics.add_argument(
        "--truth", metavar="TOPIC", help="true flow (default: /truth/flow if present)"
    )
    topics.add_argument(
        "--odometry",
        metavar="TOPIC",
        help="sensor poses, for the method ego, and for other methods with "
        "--set ego_motion.source=odometry (default: /truth/odometry if present)",
    )
    _add_method_arguments(parser.add_argument_group("methods and points"))
    _add_run_arguments(parser.add_argument_group("run"))
    parser.set_defaults(run=_run)


def _add_method_arguments(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--methods",
        action="append",
        metavar="NAME,...",
        help="methods to compare, see docs/evaluation.md; file:DIR scores flow from files, "
        "command:LINE runs another program (the rest of the text is its command line); may be "
        f"repeated (default: {DEFAULT_METHODS})",
    )
    add_setting_arguments(group)
    group.add_argument(
        "--num-points",
        type=_num_points,
        metavar="N",
        help="score N random points of each sweep (default: all)",
    )
    group.add_argument(
        "--pairs",
        action="store_true",
        help="evaluate every two consecutive sweeps, also without a sweep before them; methods "
        "use two sweeps if they can, else report an error",
    )
    group.add_argument(
        "--every",
        type=int,
        default=1,
        metavar="N",
        help="score every N-th example only; methods that carry state still estimate those "
        "between (default: 1, all; not with --realtime)",
    )
    group.add_argument(
        "--seed",
        type=int,
        default=0,
        metavar="S",
        help="seed of the random points and of the methods (default: 0)",
    )
    group.add_argument(
        "--ground",
        choices=("truth", "settings"),
        default="truth",
        help="find ground points by the flags in the truth, where there is truth, or by the "
        "ground settings, as the live node does (default: truth)",
    )
    group.add_argument(
        "--check-cycle",
        action="store_true",
        help="also estimate the flow back and report how far from its start a point ends "
        "(doubles the run time)",
    )


def _add_run_arguments(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="folder for results (default: a new one named after recording and time)",
    )
    group.add_argument(
        "--resume",
        action="store_true",
        help="continue an interrupted run: repeat the command and add --resume",
    )
    group.add_argument(
        "--realtime",
        type=float,
        metavar="RATE",
        help="replay in real time: triplets are dropped as in the live node; 1 is the "
        "speed of the recording, 2 twice as fast (default: no drops)",
    )
    group.add_argument(
        "--write-flow", action="store_true", help="store the flow as recordings in DIR/flow"
    )
    group.add_argument(
        "--pictures",
        type=int,
        default=3,
        metavar="N",
        help="show the N worst examples in report.html (default: 3); without --write-flow they "
        "are estimated again, for at most a minute",
    )
    group.add_argument(
        "--workers", type=int, default=1, metavar="N", help="processes to use (default: 1)"
    )
    group.add_argument(
        "--ray", metavar="ADDRESS", help="run on a Ray cluster; local starts one here"
    )
    group.add_argument(
        "--num-gpus",
        type=float,
        metavar="G",
        help="GPU share of each --ray task (default: 1 with compute.device=cuda, else 0)",
    )


def _num_points(text: str) -> int | None:
    if text != _ALL_POINTS and not text.lstrip("+-").isdecimal():
        raise argparse.ArgumentTypeError(f"got {text!r}, expected a number or {_ALL_POINTS!r}")
    return None if text == _ALL_POINTS else int(text)


def _run(options: argparse.Namespace) -> int:
    from mnsf_ros.cli.evaluation_progress import PatientConsole
    from mnsf_ros.cli.evaluation_run import evaluate, new_folder
    from mnsf_ros.evaluation.options import EvaluationOptions
    from mnsf_ros.evaluation.run_folder import WritingError
    from mnsf_ros.evaluation.run_record import path_text

    console = PatientConsole()
    if options.out is None:
        if options.resume:
            raise SettingsError("--resume needs --out DIR, the folder of the interrupted run")
        options.out = new_folder(options.bags)
        console.print(f"Results folder: {options.out}", markup=False, highlight=False)
    settings = preset(options.preset).changed(parse_assignments(options.assignments))
    evaluation = EvaluationOptions(
        settings=settings,
        num_points=options.num_points,
        every=options.every,
        seed=options.seed,
        ground=options.ground,
        realtime_rate=options.realtime,
        check_cycle=options.check_cycle,
        flow_folder=options.out / "flow" if options.write_flow else None,
    )
    try:
        is_complete = evaluate(options, evaluation, console)
    except WritingError as error:
        print(
            f"mnsf: {error}. Finished results are kept; to continue, repeat the command with "
            f"--out {path_text(options.out)} --resume",
            file=sys.stderr,
        )
        return EXIT_UNWRITTEN
    return 0 if is_complete else EXIT_INCOMPLETE
