"""`mnsf evaluate`: methods on recordings, with tables at the end."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from mnsf_ros.cli.patient_console import PatientConsole
from mnsf_ros.cli.setting_values import add_setting_arguments, parse_assignments
from mnsf_ros.presets import preset

EXIT_DAMAGED = 3
EXIT_UNWRITTEN = 4
ALL_POINTS = "all"

_EPILOG = """\
Example, the online method as a robot gets it:
  mnsf simulate street
  mnsf evaluate street --methods zero,mnsf --preset online --realtime 1 --out results

Exit status 0: all done; 2: something that was given cannot be used; 3: done, but a
recording is damaged (its readable part was evaluated) or has nothing to evaluate, a task
gave up, a method failed on every example of a recording (the notes tell), or there is no
report; 4: stopped, because results cannot be written, such as to a full disk; 130:
interrupted. After 4 and 130 what is finished is kept, and the same command with --resume
goes on from there.
"""


def add_to(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds the subcommand."""
    parser = subparsers.add_parser(
        "evaluate",
        help="score methods on recordings",
        description="Estimates the flow of whole recordings, scores it and prints tables.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("bags", nargs="+", type=Path, metavar="BAG", help="recordings")
    topics = parser.add_argument_group("topics, of all recordings alike")
    topics.add_argument(
        "--points",
        metavar="TOPIC",
        help="topic of the clouds; needed only if the recording has several",
    )
    topics.add_argument("--truth", metavar="TOPIC", help="true flow (default: /truth/flow, if any)")
    topics.add_argument(
        "--odometry",
        metavar="TOPIC",
        help="sensor poses: for the row ego, and for other methods with "
        "--set ego_motion.source=odometry (default: /truth/odometry, if any)",
    )
    _add_method_arguments(parser.add_argument_group("methods and points"))
    _add_run_arguments(parser.add_argument_group("running"))
    parser.set_defaults(run=_run)


def _add_method_arguments(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--methods",
        action="append",
        metavar="NAME,...",
        help="methods, see docs/evaluation.md; file:DIR for flow that another program wrote, "
        "command:LINE for a program that makes them (all that follows is its command line); may "
        "be repeated (default: mnsf)",
    )
    add_setting_arguments(group)
    group.add_argument(
        "--num-points",
        type=_num_points,
        metavar="N",
        help="random points of each sweep, or all (default: all)",
    )
    group.add_argument(
        "--pairs",
        action="store_true",
        help="every two sweeps in a row are an example, also where there is none before them; "
        "methods that look at more make do, or fail",
    )
    group.add_argument(
        "--every",
        type=int,
        default=1,
        metavar="N",
        help="score every N-th example only; methods that carry something over estimate those "
        "between, too (default 1: all; not with --realtime)",
    )
    group.add_argument(
        "--seed",
        type=int,
        default=0,
        metavar="S",
        help="seed of the random points and of the methods (default 0)",
    )
    group.add_argument(
        "--ground",
        choices=("truth", "settings"),
        help="which points ground removal removes: those flagged as ground in the truth, where "
        "there is truth; or what the ground settings find, as in the live node (default: truth, "
        "with --realtime settings)",
    )
    group.add_argument(
        "--check-cycle",
        action="store_true",
        help="estimate the way back, too, and tell how far from its start a point ends: twice the "
        "work",
    )


def _add_run_arguments(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for results")
    group.add_argument(
        "--resume",
        action="store_true",
        help="go on with what is in DIR: the whole command once more, and this",
    )
    group.add_argument(
        "--realtime",
        type=float,
        metavar="RATE",
        help="give the methods whole sweeps, and drop triplets, as the node does; 1 is the robot's "
        "own time, 2 twice as fast (default: no drops, and sweeps without ground)",
    )
    group.add_argument(
        "--write-flow", action="store_true", help="write the flow as recordings, too, into DIR/flow"
    )
    group.add_argument(
        "--pictures",
        type=int,
        default=3,
        metavar="N",
        help="show so many of the worst examples in pictures in report.html (default 3); without "
        "--write-flow they are estimated once more, for a minute at most",
    )
    group.add_argument(
        "--workers", type=int, default=1, metavar="N", help="processes on this machine (default 1)"
    )
    group.add_argument("--ray", metavar="ADDRESS", help="run on a Ray cluster; local starts one")
    group.add_argument(
        "--num-gpus",
        type=float,
        metavar="G",
        help="share of a GPU for each task of --ray (default: 1 with compute.device=cuda, else 0)",
    )


def _num_points(text: str) -> int | None:
    if text != ALL_POINTS and not text.lstrip("+-").isdecimal():
        raise argparse.ArgumentTypeError(f"got {text!r}, expected a number or {ALL_POINTS!r}")
    return None if text == ALL_POINTS else int(text)


def _run(options: argparse.Namespace) -> int:
    from mnsf_ros.cli.evaluation_run import evaluate
    from mnsf_ros.evaluation.options import EvaluationOptions
    from mnsf_ros.evaluation.run_folder import WritingError

    settings = preset(options.preset).changed(parse_assignments(options.assignments))
    is_node = options.realtime is not None
    ground = options.ground or ("settings" if is_node else "truth")
    evaluation = EvaluationOptions(
        settings=settings,
        num_points=options.num_points,
        every=options.every,
        seed=options.seed,
        use_true_ground=ground == "truth",
        realtime_rate=options.realtime,
        check_cycle=options.check_cycle,
        flow_folder=options.out / "flow" if options.write_flow else None,
    )
    try:
        all_done = evaluate(options, evaluation, PatientConsole())
    except WritingError as error:
        print(f"mnsf: {error}; what is finished is kept, --resume goes on", file=sys.stderr)
        return EXIT_UNWRITTEN
    return 0 if all_done else EXIT_DAMAGED
