# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The report says what was run and found, is a page by itself, and lets nothing in or out."""

from __future__ import annotations

import dataclasses
import re
from html.parser import HTMLParser

import pytest
from small_runs import METHODS, kept, row, rows, rows_without_truth, run_record, write_run_report

from mnsf_ros.evaluation.movers import LostBy, MoverRow, ObjectRow
from mnsf_ros.evaluation.options import EvaluatedMethod
from mnsf_ros.evaluation.results import Failure, FailureKind
from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.report.run_results import results_of

without_drawing = pytest.mark.usefixtures("without_drawing")
WITHOUT_END = {"meta", "link", "img", "br"}


class Page(HTMLParser):
    """Checks that elements are nested, and collects what a test wants to see."""

    def __init__(self, text):
        super().__init__()
        self.open, self.elements, self.words = [], [], []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))
        if tag not in WITHOUT_END:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, text):
        self.words.append(text)

    @property
    def text(self):
        return " ".join(self.words)

    def all(self, tag):
        return [attributes for name, attributes in self.elements if name == tag]


def report(tmp_path, rows, run, flows=()):
    path = write_run_report(tmp_path, results_of(run, rows), flows)
    assert {file.name for file in tmp_path.iterdir()} - {"pictures"} == {"report.html"}
    return Page(path.read_text(encoding="utf-8"))


@without_drawing
def test_what_was_run_is_there(tmp_path):
    text = report(tmp_path, rows(), run_record()).text
    for fact in ("mnsf evaluate street", "abc123", "torch 2.0", "box, fast, 2 cores", "Seed 7"):
        assert fact in text
    assert "distance.cell_size_m" in text


@without_drawing
def test_settings_that_the_method_does_not_use_are_left_out(tmp_path):
    traits = make_method("online", preset("online")).traits
    run = dataclasses.replace(run_record(["online"]), methods=[EvaluatedMethod("online", traits)])
    text = report(tmp_path, [row(1, "online", 0.1)], run).text
    for name in ("objects.max_suspects", "crop.max_range_m", "ego_motion.source"):
        assert name in text
    for name in ("field.hidden_width", "fusion.kind", "node.odom_frame", "lidar_2.x_m"):
        assert name not in text


@without_drawing
def test_means_are_over_examples_of_each_method(tmp_path):
    text = report(tmp_path, rows(), run_record()).text
    assert "0.200 m" in text  # mnsf: 0.1, 0.2, 0.3
    assert "0.210" in text
    assert "0.220" in text
    assert "a newer triplet took its place" in text


@without_drawing
def test_best_value_is_that_of_a_method_not_of_a_reference(tmp_path):
    page = report(
        tmp_path, [row(1, "mnsf", 0.2), row(1, "fnsf", 0.3), row(1, "zero", 0.1)], run_record()
    )
    text = (tmp_path / "report.html").read_text()
    assert '<td class="best">0.200</td>' in text
    assert '<td class="best">0.100</td>' not in text
    assert page.all("table")


def test_nothing_is_loaded_from_anywhere(tmp_path):
    page = report(tmp_path, rows(), run_record(), kept())
    assert page.all("script") == []
    for _, attributes in page.elements:
        assert attributes.get("src", "data:").startswith("data:")
        assert re.match(r"data:|#", attributes.get("href", "#"))
    policies = [m["content"] for m in page.all("meta") if "http-equiv" in m]
    assert policies[0].startswith("default-src 'none'")
    assert "url(" not in (tmp_path / "report.html").read_text()


def test_every_picture_says_what_it_shows(tmp_path):
    page = report(tmp_path, rows(), run_record(), [*kept(3), *kept(2)])
    images = page.all("img")
    assert len(images) == 2 * 3  # truth and two methods
    assert all(len(image["alt"]) > 20 for image in images)
    drawings = [svg for svg in page.all("svg") if svg.get("aria-hidden") != "true"]
    assert drawings
    assert all(svg["role"] == "img" and svg["aria-label"] for svg in drawings)
    assert {link["href"] for link in page.all("a")} <= {
        f"#{section['id']}" for section in page.all("section") if "id" in section
    }


@without_drawing
def test_worst_examples_come_first(tmp_path):
    text = report(tmp_path, rows(), run_record()).text
    text = text[text.index("The worst 3 of 3 sweeps of mnsf") :]
    places = [text.index(f"street, sweep {number}") for number in (3, 2, 1)]
    assert places == sorted(places)


def missed_mover(name="<b>car</b>"):
    item = ObjectRow(
        7, name, True, 5.0, 12.0, 120, 0.0, place_m=(8.0, -9.0), lost_by=LostBy.TOO_LARGE
    )
    return row(3, "mnsf", 0.3, movers=MoverRow((0, 0, 120), 0, objects=[item]))


@without_drawing
def test_missed_mover_is_listed_and_pictured_with_what_lost_it(tmp_path):
    found = [missed_mover(), row(2, "mnsf", 0.2)]
    page = report(
        tmp_path, found, run_record(), [*kept(methods=["mnsf"]), *kept(methods=["mnsf"], mover=7)]
    )
    assert "Movers that mnsf missed in most sweeps" in page.text
    assert "Missed: <b>car</b> in street" in page.text
    assert "missed in 1 sweeps, here lost by: too large" in page.text
    # The sweep is the worst one, too: truth, flow, and the mover.
    *_, image = page.all("img")
    assert len(page.all("img")) == 3
    assert "Motion around the <b>car</b>" in image["alt"]


@without_drawing
def test_missed_mover_without_truth_or_flow_has_no_picture(tmp_path):
    flows = kept(methods=["mnsf"], mover=7, with_truth=False)
    page = report(tmp_path, [missed_mover(), row(2, "mnsf", 0.2)], run_record(), flows)
    assert page.all("img") == []
    assert "Missed: " not in page.text


@without_drawing
def test_rivals_are_shown_on_the_same_sweep_where_their_flow_was_kept(tmp_path):
    page = report(tmp_path, rows(), run_record(), [*kept(3), *kept(2, methods=["fnsf"])])
    captions = re.findall("<figcaption>([^<]*)<", (tmp_path / "report.html").read_text())
    assert [caption.partition(":")[0] for caption in captions] == ["Truth", "mnsf", "fnsf"]
    assert captions[1].startswith("mnsf: EPE 0.300 m")
    assert "2 of 3 sweeps have no picture" in page.text


@without_drawing
def test_damaged_flow_costs_only_its_picture(tmp_path):
    report(tmp_path, rows(), run_record(), kept(3))
    for file in (tmp_path / "pictures").iterdir():
        file.write_bytes(file.read_bytes()[:-2000])
    page = report(tmp_path, rows(), run_record())
    assert page.all("img") == []
    assert "3 of 3 sweeps have no picture" in page.text


def failed(number, method, failure):
    none = {"errors": {}, "by_range": {}, "by_speed": {}, "consistency": {}}
    return row(number, method, 0.0, **none, failure=Failure(FailureKind.FAILED, failure))


@without_drawing
def test_failures_that_differ_in_numbers_alone_are_one(tmp_path):
    texts = [f"sweep 17{n}00: {n}.5 points are left after crop" for n in (1, 2, 3)]
    found = [failed(n + 1, "fnsf", text) for n, text in enumerate(texts)]
    found += [failed(4, "fnsf", "cancelled"), failed(1, "nsfp", "cancelled"), *rows()[:1]]
    report(tmp_path, found, run_record())
    lines = re.findall(
        r"<tr><th[^>]*>([^<]* ×)</th><td>([^<]*)</td>", (tmp_path / "report.html").read_text()
    )
    assert lines == [
        ("fnsf: 3 ×", f"the first one: {texts[0]}"),
        ("nsfp: 1 ×", "cancelled"),
        ("fnsf: 1 ×", "cancelled"),
    ]


def test_method_without_any_flow_is_not_in_the_legend(tmp_path):
    found = [row(1, "mnsf", 0.1), failed(1, "fnsf", "cancelled"), row(1, "zero", 2.0)]
    report(tmp_path, found, run_record())
    text = (tmp_path / "report.html").read_text()
    bands = text[text.index('id="bands"') : text.index('id="time"')]
    assert set(re.findall(r">(mnsf|fnsf|zero)</text>", bands)) == {"mnsf"}
    assert "Not in these charts: zero, with an error more than 5 times that" in bands


@without_drawing
def test_without_truth_there_is_still_a_report(tmp_path):
    run = run_record(["mnsf"], truth=None)
    page = report(tmp_path, rows_without_truth(), run, kept(methods=["mnsf"], with_truth=False))
    assert "0.200 m" in page.text  # mean of the distances to the next sweep
    assert "Where the errors are" not in page.text
    assert "Where the time goes" in page.text
    assert "EPE" not in page.text
    assert "no true flow" in page.text
    assert "distance to next sweep" in page.all("img")[0]["alt"]
    assert len(page.all("img")) == 1


def test_without_rows_there_is_still_a_report(tmp_path):
    page = report(tmp_path, [], run_record())
    assert "There are no results yet." in page.text


@without_drawing
def test_text_of_others_is_no_markup(tmp_path):
    bad = "<script>alert(1)</script>\"'&"
    run = run_record([bad])
    run = dataclasses.replace(run, recordings=[dataclasses.replace(run.recordings[0], name=bad)])
    found = [dataclasses.replace(row(1, bad, 0.1), recording=bad), failed(2, bad, bad)]
    page = report(tmp_path, found, run)
    assert page.all("script") == []
    assert bad in page.text


@pytest.mark.parametrize("number", [1, 9, 30])
def test_any_number_of_methods(tmp_path, number):
    methods = [f"method {k}" for k in range(number)]
    page = report(tmp_path, [row(1, m, 0.1) for m in methods], run_record(methods))
    assert all(method in page.text for method in methods)


def test_same_rows_give_the_same_file_in_any_order(tmp_path):
    report(tmp_path, rows(), run_record())
    first = (tmp_path / "report.html").read_bytes()
    report(tmp_path, rows()[::-1], run_record(METHODS))
    assert (tmp_path / "report.html").read_bytes() == first
