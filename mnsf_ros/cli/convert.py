"""`mnsf convert`: a sequence of a public data set as a recording with truth."""

from __future__ import annotations

import argparse
from pathlib import Path

from rich.console import Console

from mnsf_ros.datasets.formats import FORMATS, TruthSettings, open_source

_DEFAULTS = TruthSettings()


def add_to(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds the subcommand."""
    formats = "\n".join(f"  {name:14} {one.source}" for name, one in FORMATS.items())
    parser = subparsers.add_parser(
        "convert",
        help="write a sequence of a public data set as a recording with its true flow",
        description="Writes a sequence of a public data set as a recording with its true flow.",
        epilog=f"formats and their sources:\n{formats}\n\nDetails: docs/recordings.md",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("format", choices=FORMATS, metavar="FORMAT", help=", ".join(FORMATS))
    parser.add_argument(
        "source",
        type=Path,
        metavar="SOURCE",
        help="file or folder of the data set; see the list of formats below",
    )
    parser.add_argument(
        "out", type=Path, metavar="OUT", help="folder to write, or a single file OUT.mcap"
    )
    parser.add_argument("--force", action="store_true", help="overwrite an existing recording")
    parser.add_argument("--compress", action="store_true", help="compress the recording (zstd)")
    parser.add_argument(
        "--sequence", metavar="NAME", help="scene (nuscenes) or segment (waymo), if several"
    )
    parser.add_argument(
        "--labels", type=Path, metavar="DIR", help="scene flow labels of the log (argoverse2)"
    )
    parser.add_argument(
        "--first", type=int, default=0, metavar="N", help="first sweep, counted from 0"
    )
    parser.add_argument("--count", type=int, metavar="N", help="number of sweeps (default: all)")
    parser.add_argument(
        "--box-margin",
        type=float,
        default=_DEFAULTS.box_margin_m,
        metavar="M",
        help="enlarge boxes by M metres in each dimension (default %(default)s)",
    )
    parser.add_argument(
        "--unlabelled-static",
        action="store_true",
        help="treat unlabelled points as static instead of as unknown",
    )
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> None:
    from mnsf_ros.datasets.recording_writer import check_out, write_recording
    from mnsf_ros.demo.console_progress import counting_progress

    check_out(options.out, overwrite=options.force)
    settings = TruthSettings(options.box_margin, options.unlabelled_static)
    source = open_source(
        options.format, options.source, sequence=options.sequence, labels=options.labels
    ).part(options.first, options.count)
    console = Console()
    with counting_progress(console) as progress:
        task = progress.add_task(f"converting {options.source.name}", total=source.num_sweeps)
        summary = write_recording(
            source,
            options.out,
            settings,
            lambda done: progress.update(task, completed=done),
            overwrite=options.force,
            compress=options.compress,
        )
    lines = [f"{summary.num_sweeps} sweeps in {options.out}", str(summary)]
    for line in (*lines, *(f"warning: {text}" for text in summary.warnings())):
        console.print(line, highlight=False, markup=False, soft_wrap=True)
