# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf export`: estimates in the files of OpenSceneFlow and Argoverse 2, read back."""

import pickle
import zipfile
from io import BytesIO

import numpy as np
import pytest
from recorded_truth import read_sensor_poses, read_truth

from mnsf_ros.cli.main import EXIT_USAGE, run
from mnsf_ros.datasets.open_scene_flow import open_file
from mnsf_ros.recording.bag_reader import BagReader

h5py = pytest.importorskip("h5py")
feather = pytest.importorskip("pyarrow.feather")


@pytest.fixture
def street(make_street):
    return make_street()


@pytest.fixture
def truth(street):
    with BagReader(street) as reader:
        return read_truth(reader)


@pytest.fixture
def exported(street, tmp_path):
    """An .h5 file with the flow of static points."""
    assert (
        run(["export", "opensceneflow", str(street), "--out", str(tmp_path), "--method", "ego"])
        == 0
    )
    return tmp_path / f"{street.name}.h5"


def arrays(path, stamp):
    with h5py.File(path) as file:
        return {name: values[...] for name, values in file[str(stamp)].items()}


def test_a_new_file_has_sweeps_poses_truth_and_estimates(street, exported, truth):
    stamps = list(truth)
    read = list(open_file(exported).sweeps)
    assert [sweep.stamp_ns for sweep in read] == stamps
    with BagReader(street) as reader:
        poses = read_sensor_poses(reader)
    numbers = set()
    for stamp, after, sweep in zip(stamps, stamps[1:], read, strict=False):
        known, found = truth[stamp], arrays(exported, stamp)
        np.testing.assert_array_equal(sweep.flow_valid, known.valid)
        np.testing.assert_array_equal(sweep.flow[known.valid], known.flow[known.valid])
        np.testing.assert_array_equal(sweep.ground, known.ground)
        assert found["flow_instance_id"].dtype == np.int16
        numbers |= set(
            zip(found["flow_instance_id"].tolist(), known.object_id.tolist(), strict=True)
        )
        cars = (known.class_id == 6) == (sweep.class_id == 6)
        assert cars.all()
        np.testing.assert_allclose(found["pose"], poses[stamp], atol=1e-5)
        motion = np.linalg.inv(poses[after]) @ poses[stamp]
        np.testing.assert_allclose(found["ego_motion"], motion, atol=1e-5)
        static = known.valid & ~known.dynamic
        np.testing.assert_allclose(found["ego"][static], known.flow[static], atol=1e-3)
    # One number for each object, the same in all sweeps.
    assert (0, 0) in numbers
    assert len(dict(numbers)) == len(numbers) == len({known for _, known in numbers})
    assert set(arrays(exported, stamps[-1])) == {"lidar", "pose", "ground_mask"}
    indexes = [exported.with_name(name) for name in ("index_total.pkl", "index_flow.pkl")]
    total, with_flow = (pickle.loads(index.read_bytes()) for index in indexes)  # noqa: S301
    assert total == [[street.name, str(stamp)] for stamp in stamps]
    assert with_flow == total[:-1]


def test_estimates_are_added_to_a_file_and_replaced_by_force_only(street, exported, truth, capsys):
    stamp = next(iter(truth))
    before = arrays(exported, stamp)
    command = ["export", "opensceneflow", str(street), "--out", str(exported.parent)]
    assert run([*command, "--method", "zero", "--key", "nothing"]) == 0
    after = arrays(exported, stamp)
    assert not after.pop("nothing").any()
    for name, values in before.items():
        np.testing.assert_array_equal(after[name], values)
    assert run([*command, "--method", "zero", "--key", "ego"]) == EXIT_USAGE
    assert "has 'ego' already; --force replaces it" in capsys.readouterr().err
    assert arrays(exported, stamp)["ego"].any()
    assert run([*command, "--method", "zero", "--key", "ego", "--force"]) == 0
    assert not arrays(exported, stamp)["ego"].any()


def test_estimates_have_a_name_without_the_slash_of_the_method(street, exported, truth):
    command = ["export", "opensceneflow", str(street), "--out", str(exported.parent)]
    assert run([*command, "--method", "paper/zero"]) == 0
    assert not arrays(exported, next(iter(truth)))["paper_zero"].any()


def test_labels_to_train_on_are_the_estimate(street, tmp_path, truth):
    command = ["export", "opensceneflow", str(street), "--out", str(tmp_path), "--labels"]
    assert run(command) == 0
    stamps = list(truth)
    found = [arrays(tmp_path / f"{street.name}.h5", stamp) for stamp in stamps[:-1]]
    for each in found:
        np.testing.assert_array_equal(each["flow"], each["online"])
        assert each["flow_is_valid"].all()
        np.testing.assert_array_equal(each["dufo"] > 0, each["flow_category_indices"] > 0)
        np.testing.assert_array_equal(each["dufocluster"] > 0, each["flow_instance_id"] > 0)
        assert each["dufocluster"].max() == len(np.unique(each["dufocluster"])) - 1
    assert any(each["dufo"].any() for each in found)


def drop_a_point(file, stamp):
    points = file[stamp]["lidar"][1:]
    del file[stamp]["lidar"]
    file[stamp]["lidar"] = points


def move_the_points(file, stamp):
    file[stamp]["lidar"][...] += 1.0


def lead_elsewhere(file, stamp):
    del file[stamp]
    file[stamp] = h5py.ExternalLink("other.h5", "/")


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (drop_a_point, "has other points than the recording"),
        (move_the_points, "has other points than the recording"),
        (lead_elsewhere, "cannot be read: group "),
        (lambda file, stamp: file.move(stamp, "17"), "has no sweep of stamp"),
        (lambda file, stamp: file.move(stamp, "points"), "has group 'points', expected one named"),
    ],
)
def test_a_file_of_other_sweeps_is_refused_and_stays(street, exported, truth, spoil, words, capsys):
    with h5py.File(exported, "a") as file:
        spoil(file, str(next(iter(truth))))
    before = exported.read_bytes()
    command = ["export", "opensceneflow", str(street), "--out", str(exported.parent)]
    assert run([*command, "--method", "zero"]) == EXIT_USAGE
    assert words in capsys.readouterr().err
    assert exported.read_bytes() == before
    assert len(list(exported.parent.iterdir())) == 3


def write_masks(path, masks):
    with zipfile.ZipFile(path, "w") as archive:
        for name, mask in masks.items():
            content = BytesIO()
            feather.write_feather(pytest.importorskip("pyarrow").table({"mask": mask}), content)
            archive.writestr(f"{name}.feather", content.getvalue())
    return path


def test_a_submission_has_the_points_of_the_masks(street, tmp_path, truth, capsys):
    stamps = [*truth][:2]
    near = {stamp: np.arange(len(truth[stamp])) % 3 == 0 for stamp in stamps}
    masks = {f"{street.name}/{stamp}": mask for stamp, mask in near.items()}
    masks["another_log/5"] = np.ones(4, bool)
    target = tmp_path / "online.zip"
    command = ["export", "argoverse2-2023", str(street), "--out", str(target), "--mask"]
    assert run([*command, str(write_masks(tmp_path / "masks.zip", masks))]) == 0
    said = " ".join(capsys.readouterr().err.split())
    assert "lacks 1 sweeps of 1 logs of the challenge, for example of another_log" in said
    with zipfile.ZipFile(target) as archive:
        assert sorted(archive.namelist()) == sorted(f"{street.name}/{s}.feather" for s in stamps)
        for stamp, mask in near.items():
            table = feather.read_table(BytesIO(archive.read(f"{street.name}/{stamp}.feather")))
            columns = {name: table.column(name).to_numpy() for name in table.column_names}
            kinds = [(name, column.dtype.name) for name, column in columns.items()]
            assert kinds == [*((f"flow_t{a}_m", "float16") for a in "xyz"), ("is_dynamic", "bool")]
            assert len(table) == mask.sum()
            known = truth[stamp].of_points(np.flatnonzero(mask))
            errors = np.column_stack(list(columns.values())[:3]) - known.flow
            assert np.nanmedian(np.linalg.norm(errors, axis=1)) < 0.05
            # The street is coarse, and these are its first sweeps.
            assert (columns["is_dynamic"] == known.dynamic)[known.valid].mean() > 0.7


@pytest.mark.parametrize(
    ("masks", "words"),
    [
        ({}, "holds no mask"),
        ({"street/STAMP": [True, False]}, "is for 2 points, the recorded sweep has"),
        (None, "cannot be read: File is not a zip file"),
    ],
)
def test_masks_that_do_not_fit_are_refused(street, tmp_path, truth, masks, words, capsys):
    path = tmp_path / "masks.zip"
    if masks is None:
        path.write_text("masks")
    else:
        stamp = str(next(iter(truth)))
        write_masks(path, {name.replace("STAMP", stamp): mask for name, mask in masks.items()})
    target = tmp_path / "out.zip"
    command = ["export", "argoverse2-2023", str(street), "--out", str(target), "--method", "zero"]
    assert run([*command, "--mask", str(path)]) == EXIT_USAGE
    assert words in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [path]


# As the file of group names of Argoverse 2 has them; ZOD's are in 100 ns.
@pytest.mark.parametrize("unit_ns", [1, 100])
def test_a_submission_of_v3_has_residual_flow_of_all_points(street, tmp_path, truth, unit_ns):
    stamps, target, index = [*truth][:2], tmp_path / "online.zip", tmp_path / "index_eval.pkl"
    index.write_bytes(pickle.dumps([[street.name, str(stamp // unit_ns)] for stamp in stamps]))
    command = ["export", "argoverse2-v3", str(street), "--out", str(target), "--index", str(index)]
    assert run([*command, "--method", "ego"]) == 0
    with zipfile.ZipFile(target) as archive:
        names = [f"{street.name}/{stamp // unit_ns}.feather" for stamp in stamps]
        assert archive.namelist() == names
        for name, stamp in zip(names, stamps, strict=True):
            table = feather.read_table(BytesIO(archive.read(name)))
            assert table.column_names == ["flow_tx_m", "flow_ty_m", "flow_tz_m"]
            columns = [column.to_numpy() for column in table.columns]
            assert {column.dtype.name for column in columns} == {"float16"}
            assert len(table) == len(truth[stamp])
            # Points of an estimate of the ego motion are static.
            assert np.abs(columns).max() < 1e-3


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (pickle.dumps(np.float32(1)), "cannot be read: it names numpy"),
        (pickle.dumps([("a", "5", 7)]), "cannot be read: too many values to unpack"),
        (pickle.dumps([("../a", "5")]), "cannot be read: found '../a' and '5', expected scene"),
        (pickle.dumps([("a", "now")]), "cannot be read: found 'a' and 'now', expected scene"),
        (pickle.dumps([]), "holds no sweep, expected pairs of scene and stamp"),
        (b"", "cannot be read: Ran out of input"),
    ],
)
def test_an_index_that_is_none_is_refused(street, tmp_path, content, words, capsys):
    index = tmp_path / "index.pkl"
    index.write_bytes(content)
    command = ["export", "argoverse2-v3", str(street), "--out", str(tmp_path / "a.zip")]
    assert run([*command, "--index", str(index)]) == EXIT_USAGE
    assert words in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [index]


def test_recordings_of_one_name_are_refused(street, tmp_path, capsys):
    other = tmp_path / street.name
    other.mkdir()
    (other / "points.mcap").write_bytes((street / f"{street.name}.mcap").read_bytes()[:-1])
    command = ["export", "opensceneflow", str(street), str(other), "--out", str(tmp_path / "out")]
    assert run(command) == EXIT_USAGE
    assert "has the name of another recording" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["opensceneflow", "--key", "lidar"], "key 'lidar': is no name of an estimate"),
        (["opensceneflow", "--mask", __file__], "--mask and --index: are for the formats argo"),
        (["argoverse2-2023", "--index", __file__], "argoverse2-2023: --mask is missing"),
        (
            ["argoverse2-v3", "--index", __file__, "--labels"],
            "argoverse2-v3: takes --index, but no other",
        ),
    ],
)
def test_options_that_do_not_fit_are_refused(street, tmp_path, arguments, words, capsys):
    name, *others = arguments
    assert run(["export", name, str(street), "--out", str(tmp_path / "out"), *others]) == EXIT_USAGE
    assert words in capsys.readouterr().err


def test_damage_of_a_recording_is_told(make_street, tmp_path, capsys):
    street = make_street(duration_s=1.0, num_beams=32)
    cut, whole = tmp_path / "cut.mcap", next(street.glob("*.mcap")).read_bytes()
    cut.write_bytes(whole[: len(whole) * 6 // 10])
    out = str(tmp_path / "flows")
    assert run(["export", "opensceneflow", str(cut), "--out", out, "--method", "ego"]) == 5
    assert f"{cut}, byte " in capsys.readouterr().err
