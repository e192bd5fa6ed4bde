"""`mnsf study`: the paper's ablation tables and case studies."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from rich.console import Console

from mnsf_ros.cli.arguments import add_setting_arguments, parse_assignments
from mnsf_ros.errors import SettingsError
from mnsf_ros.presets import preset

_NAMES = {
    "ablation": "FNSF, and MNSF without single parts: (a) to (d) of the paper",
    "fusion": "fusion by mean, by weighted sum and by a network",
    "depth": "fusion network with 2, 3, 5 and 7 layers",
    "frames": "2, 3, 4 and 5 sweeps",
    "landscape": "loss around the optimum, FNSF and MNSF",
    "stability": "effect of replacing one point of N, expected to fall with 1/N",
}
_EPILOG = "Studies:\n" + "\n".join(f"  {name:<10} {text}" for name, text in _NAMES.items())


def add_to(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds the subcommand."""
    parser = subparsers.add_parser(
        "study",
        help="reproduce a table or case study of the paper",
        description="Writes NAME.md, NAME.csv and NAME.png into a folder.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("name", choices=_NAMES, metavar="NAME", help="study, see below")
    parser.add_argument(
        "bags", nargs="*", type=Path, metavar="BAG", help="recordings (default: a simulated street)"
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="folder for results (default: study_NAME)"
    )
    parser.add_argument(
        "--resume",
        action="store_true",
        help="continue an interrupted run: repeat the command and add --resume",
    )
    add_setting_arguments(parser)
    parser.add_argument(
        "--num-points",
        default="",
        metavar="N",
        help="use N random points of each sweep, or all (default: 2048; stability: all)",
    )
    parser.add_argument(
        "--max-examples",
        type=int,
        metavar="N",
        help="use the first N examples of each recording (default: all; 4 of a simulated street); "
        "landscape and stability use the first one",
    )
    parser.add_argument(
        "--seed", type=int, default=0, metavar="S", help="seed of everything random (default: 0)"
    )
    _add_case_study_arguments(parser)
    parser.set_defaults(run=_run)


def _add_case_study_arguments(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("landscape")
    group.add_argument(
        "--radius",
        type=float,
        default=0.5,
        metavar="R",
        help="half width of the picture around the optimum, in lengths of the weight vector "
        "(default: 0.5)",
    )
    group.add_argument(
        "--steps",
        type=int,
        default=21,
        metavar="N",
        help="grid points along each side of the picture, odd (default: 21)",
    )
    group.add_argument(
        "--directions",
        type=int,
        default=10,
        metavar="N",
        help="random directions in which sharpness is measured (default: 10)",
    )
    group = parser.add_argument_group("stability")
    group.add_argument(
        "--sizes",
        default="128,256,512,1024,2048",
        metavar="N,...",
        help="numbers of points, at least three values (default: %(default)s)",
    )
    group.add_argument(
        "--repeats",
        type=int,
        default=5,
        metavar="N",
        help="random draws for each number of points (default: 5)",
    )
    group.add_argument(
        "--methods",
        default="nsfp,fnsf,mnsf",
        metavar="NAME,...",
        help="methods to compare (default: %(default)s)",
    )


def _run(options: argparse.Namespace) -> None:
    from mnsf_ros.studies.run_study import run_study
    from mnsf_ros.studies.study import StudyOptions

    console = Console()

    def say(text: str) -> None:
        console.print(text, markup=False, highlight=False)

    study = StudyOptions(
        out=options.out or Path(f"study_{options.name}"),
        settings=preset(options.preset).changed(parse_assignments(options.assignments)),
        recordings=tuple(options.bags),
        num_points=_num_points(options),
        max_examples=options.max_examples,
        seed=options.seed,
        resume=options.resume,
        command=tuple(sys.argv),
        say=say,
        radius=options.radius,
        num_steps=options.steps,
        num_directions=options.directions,
        sizes=tuple(_numbers("sizes", options.sizes)),
        num_repeats=options.repeats,
        methods=tuple(options.methods.split(",")),
    )
    result, paths = run_study(options.name, study)
    for table in result.tables:
        console.print(table)
    for text in (*result.texts, f"Written: {', '.join(map(str, paths))}"):
        say(text)


def _num_points(options: argparse.Namespace) -> int | None:
    """What was asked for; else a few thousand, and for stability all, which it draws from."""
    text = options.num_points or ("all" if options.name == "stability" else "2048")
    return None if text == "all" else _numbers("num_points", text)[0]


def _numbers(name: str, text: str) -> list[int]:
    try:
        return [int(part) for part in text.split(",")]
    except ValueError as error:
        raise SettingsError(f"{name}: got {text!r}, expected whole numbers") from error
