"""The report says what was run and found, is a page by itself, and lets nothing in or out."""

from __future__ import annotations

import dataclasses
import re
from html.parser import HTMLParser

import pytest
from small_runs import METHODS, pictured, row, rows, rows_without_truth, run_record

from mnsf_ros.drawing.example_pictures import Again
from mnsf_ros.evaluation.movers import LostBy, MoverRow, ObjectRow
from mnsf_ros.evaluation.results import Failure, FailureKind
from mnsf_ros.report.cards import cards_of
from mnsf_ros.report.closer_look import closer_look
from mnsf_ros.report.page import write_report
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


def report(tmp_path, rows, run, pictured=()):
    path, results = tmp_path / "report.html", results_of(run, rows)
    look = closer_look(results)
    write_report(results, path, look, cards_of(results.rows, look, pictured))
    assert [file.name for file in tmp_path.iterdir()] == ["report.html"]
    return Page(path.read_text(encoding="utf-8"))


@without_drawing
def test_what_was_run_is_there(tmp_path):
    text = report(tmp_path, rows(), run_record()).text
    for fact in ("mnsf evaluate street", "abc123", "torch 2.0", "box, fast, 2 cores", "Seed 7"):
        assert fact in text
    assert "distance.cell_size_m" in text


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
    page = report(tmp_path, rows(), run_record(), pictured=[pictured()])
    assert page.all("script") == []
    for _, attributes in page.elements:
        assert attributes.get("src", "data:").startswith("data:")
        assert re.match(r"data:|#", attributes.get("href", "#"))
    policies = [m["content"] for m in page.all("meta") if "http-equiv" in m]
    assert policies[0].startswith("default-src 'none'")
    assert "url(" not in (tmp_path / "report.html").read_text()


def test_every_picture_says_what_it_shows(tmp_path):
    page = report(tmp_path, rows(), run_record(), pictured=[pictured(3), pictured(2)])
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
    page = report(tmp_path, found, run_record(), pictured=[pictured()])
    assert "Movers that mnsf missed in most sweeps" in page.text
    assert "Missed: <b>car</b> in street" in page.text
    assert "missed in 1 sweeps, here lost by: too large" in page.text
    # The sweep is the worst one, too: truth, two methods, and the mover.
    *_, image = page.all("img")
    assert len(page.all("img")) == 4
    assert "What moves around the <b>car</b>" in image["alt"]


@pytest.mark.parametrize(
    "example", [pictured(with_truth=False), dataclasses.replace(pictured(), flows=[])]
)
def test_missed_mover_without_truth_or_flow_has_no_picture(tmp_path, example):
    found = [missed_mover()]
    page = report(tmp_path, found, run_record(), pictured=[example])
    assert len(page.all("img")) == (2 if example.flows else 1), "those of the worst sweep alone"
    assert "Missed: " not in page.text


@without_drawing
def test_picture_of_another_flow_says_so(tmp_path):
    found = [row(3, "mnsf", 9.0), row(3, "fnsf", float(pictured().flows[1].error_m.mean()))]
    text = report(tmp_path, found, run_record(), pictured=[pictured()]).text
    assert text.count("The picture shows another flow than that of the run") == 1


@without_drawing
def test_new_estimate_of_a_flow_that_went_on_from_others_says_so(tmp_path):
    example = pictured()
    flows = [dataclasses.replace(flow, again=Again(8)) for flow in example.flows]
    example = dataclasses.replace(example, flows=flows)
    found = [row(3, "mnsf", 9.0), row(3, "fnsf", float(flows[1].error_m.mean()))]
    report(tmp_path, found, run_record(), pictured=[example])
    captions = re.findall("<figcaption>([^<]*)<", (tmp_path / "report.html").read_text())
    (mnsf,) = [caption for caption in captions if caption.startswith("mnsf: ")]
    (fnsf,) = [caption for caption in captions if caption.startswith("fnsf: ")]
    assert "EPE 9.000 m" in mnsf
    mean_m = float(flows[0].error_m.mean())
    assert "Estimated again for the picture, after the 8 sweeps before" in mnsf
    assert f"mean error {mean_m:.4f} m here, 9.0000 m in the run. The method had seen" in mnsf
    assert fnsf.endswith("Estimated again for the picture, after the 8 sweeps before")


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
    example = dataclasses.replace(pictured(with_truth=False), error_name="distance to next sweep")
    run = run_record(["mnsf"], truth=None)
    page = report(tmp_path, rows_without_truth(), run, pictured=[example])
    assert "0.200 m" in page.text  # mean of the distances to the next sweep
    assert "Where the errors are" not in page.text
    assert "Where the time goes" in page.text
    assert "EPE" not in page.text
    assert "no true flow" in page.text
    assert len(page.all("img")) == 2


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
