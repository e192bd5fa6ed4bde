"""`mnsf study` as users run it, on a street that is simulated in a second."""

from pathlib import Path

import pytest

from mnsf_ros.cli.main import EXIT_USAGE, run
from mnsf_ros.simulation.recording import write_recording
from mnsf_ros.simulation.settings import SimulationSettings

FEW_STEPS = [
    f"--set={setting}"
    for setting in (
        "crop.max_range_m=20",
        "distance.kind=tree",
        "field.num_hidden_layers=2",
        "field.hidden_width=8",
        "fusion.hidden_width=8",
        "optimization.max_iterations=3",
        "fusion.max_iterations=3",
    )
]


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recordings") / "street"
    settings = SimulationSettings(seed=1, duration_s=0.5, num_beams=16, num_columns=256)
    write_recording(settings, path)
    return path


def study(name: str, *arguments: object) -> int:
    return run(["study", name, *map(str, arguments), "--num-points=100", *FEW_STEPS])


def test_table_is_printed_and_written(
    street: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert study("fusion", street, "--out", out) == 0
    printed = capsys.readouterr().out
    for text in ("weighted sum", "EPE (m)", "12 of 12: mnsf-mlp", "Written: "):
        assert text in printed
    names = {path.name for path in out.iterdir()}
    assert names == {"fusion.md", "fusion.csv", "fusion.png", "evaluation"}
    assert "| weighted sum |" in (out / "fusion.md").read_text()


def test_number_of_examples_is_limited(
    street: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert study("fusion", street, "--max-examples", 1, "--out", tmp_path / "out") == 0
    assert "4 of 4: mnsf-mlp" in capsys.readouterr().out


def test_options_may_stand_anywhere(
    street: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, few = str(tmp_path / "out"), [*FEW_STEPS, "--num-points", "100"]
    arguments = ["--max-examples", "1", "fusion", "--out", out, str(street), "--seed", "1"]
    assert run(["study", *arguments, *few]) == 0
    assert "4 of 4: mnsf-mlp" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "how"),
    [
        ("landscape", ["--radius=0.2", "--steps=3", "--directions=2"]),
        ("stability", ["--sizes=16,32", "--repeats=1", "--methods=fnsf", "--num-points=all"]),
    ],
)
def test_case_study_takes_its_own_options(
    street: Path, tmp_path: Path, name: str, how: list[str]
) -> None:
    out = tmp_path / "out"
    assert run(["study", name, str(street), *FEW_STEPS, *how, "--out", str(out)]) == 0
    rows = (out / f"{name}.csv").read_text().splitlines()
    # Three landscapes of 3 x 3 steps and 2 directions of 4 radii; 2 sizes in 3 sweeps.
    assert len(rows) - 1 == {"landscape": 3 * (9 + 8), "stability": 2 * 3}[name]


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["fusion", "--max-examples=0"], "max_examples: got 0"),
        (["fusion", "--set=crop.max_range=3"], "unknown setting 'crop.max_range'"),
        (["fusion", "/nowhere"], "/nowhere"),
        (["stability", "--sizes=many"], "sizes: got 'many'"),
        (["stability", "--methods=mnfs"], "unknown method 'mnfs'"),
        (["stability", "--sizes=100000"], "sizes: got 100000"),
    ],
)
def test_what_cannot_be_used_is_one_line(
    street: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    text: str,
) -> None:
    name, *others = arguments
    bags = [] if "/nowhere" in others else [street]
    assert study(name, *bags, *others, "--out", tmp_path / "out") == EXIT_USAGE
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert text in lines[0]


def test_folder_with_a_study_is_not_written_to(
    street: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["fusion", street, "--max-examples=1", "--out", tmp_path / "out"]
    assert study(*arguments) == 0
    assert study(*arguments) == EXIT_USAGE
    assert "exists already" in capsys.readouterr().err
    assert study(*arguments, "--resume") == 0
