# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The report has the run and its results, is a page by itself, and lets nothing in or out."""

import os
import re
from html.parser import HTMLParser

from small_runs import (
    METHODS,
    failed,
    kept,
    recording,
    row,
    rows,
    rows_without_truth,
    run_record,
    write_run_report,
)

from mnsf_ros.evaluation.movers import LostBy, MoverRow, ObjectRow
from mnsf_ros.report.run_results import results_of

WITHOUT_END = {"meta", "link", "img", "br"}


class Page(HTMLParser):
    """Checks that elements are nested, and collects what a test wants to see."""

    def __init__(self, source):
        super().__init__()
        self.source, self.open, self.elements, words = source, [], [], []
        self.handle_data = words.append
        self.feed(source)
        assert self.open == []
        self.text = " ".join(words)

    def handle_starttag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))
        if tag not in WITHOUT_END:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def all(self, tag):
        return [attributes for name, attributes in self.elements if name == tag]


def report(tmp_path, rows, run, pictures=()):
    path = write_run_report(tmp_path, results_of(run, rows), pictures)
    assert {file.name for file in tmp_path.iterdir()} - {"pictures"} == {"report.html"}
    return Page(path.read_text(encoding="utf-8"))


def test_the_run_its_means_and_the_worst_sweeps_are_there(tmp_path):
    text = report(tmp_path, rows(), run_record(), [*kept(2), *kept(3)]).text
    for fact in ("mnsf evaluate street", "abc123", "box, fast, 2 cores", "seed 7"):
        assert fact in text
    for mean in ("0.200", "0.210", "0.220"):
        assert mean in text
    places = [text.index(f"street, sweep {number}") for number in (3, 2)]
    assert places == sorted(places)


def test_nothing_is_loaded_and_every_picture_says_what_it_shows(tmp_path):
    page = report(tmp_path, rows(), run_record(), [*kept(3), *kept(2)])
    assert page.all("script") == []
    for _, attributes in page.elements:
        assert attributes.get("src", "data:").startswith("data:")
        assert re.match(r"data:|#", attributes.get("href", "#"))
    policies = [m["content"] for m in page.all("meta") if "http-equiv" in m]
    assert policies[0].startswith("default-src 'none'")
    assert "url(" not in page.source
    images = page.all("img")
    assert len(images) == 2
    assert all(len(image["alt"]) > 20 for image in images)
    sections = {f"#{section['id']}" for section in page.all("section") if "id" in section}
    assert {link["href"] for link in page.all("a")} <= sections


def test_missed_mover_is_listed_with_the_stage_that_rejected_it(tmp_path):
    place = {"place_m": (8.0, -9.0), "lost_by": LostBy.TOO_LARGE}
    item = ObjectRow(7, "<b>car</b>", True, 5.0, 12.0, 120, 0.0, **place)
    scored = MoverRow((0, 0, 120), 0, objects=[item])
    missed = [row(number, "mnsf", 0.3, movers=scored, stamp_ns=10**8 * number) for number in (1, 4)]
    page = report(tmp_path, missed[:1], run_record())
    assert "not counted by “found”: in the first 0.3 s in view" in page.text
    assert "Movers that mnsf missed" not in page.text
    page = report(tmp_path, missed, run_record())
    # It is found in no sweep that counts.
    assert "Movers that mnsf missed in most sweeps" in page.text
    assert "street: <b>car</b>" in page.text
    assert "too large" in page.text


def test_plots_have_a_dot_for_each_method_and_value(tmp_path):
    movers = MoverRow((90, 10, 0), 0)
    page = report(tmp_path, [*rows(), row(4, "mnsf", 0.1, movers=movers)], run_record())
    plots = dict(re.findall("<b>([^<]*)</b></figcaption>(<svg.*?</svg>)", page.source))
    assert list(plots) == [
        *("EPE by range", "EPE by true speed", "Points called dynamic", "Time per stage")
    ]
    dots = {title: svg.count("<circle") for title, svg in plots.items()}
    assert dots == {
        "EPE by range": 9,
        "EPE by true speed": 6,
        "Points called dynamic": 3,
        "Time per stage": 6,
    }
    assert "mnsf: 90" in plots["Points called dynamic"]


def test_best_value_of_the_methods_is_bold(tmp_path):
    page = report(tmp_path, rows(), run_record())
    (table,) = re.findall(r"<b>All points.*?</table>", page.source, re.DOTALL)
    # Means of 0.2, 0.21, and 0.22, which is that of a reference; the accuracies are equal.
    assert re.findall(r"<td><b>(.*?)</b>", table) == ["0.200"]


def test_picture_that_cannot_be_read_is_left_out(tmp_path):
    page = report(tmp_path, rows(), run_record(), kept(3))
    (caption,) = re.findall("<figcaption>([^<]+)<", page.source)
    assert caption == (
        "street, sweep 3, 3.000 s: EPE 0.300 m. Left: truth. Middle: mnsf. Right: errors from "
        "above, to 50 m, red from 0.3 m."
    )
    for file in (tmp_path / "pictures").rglob("*.png"):
        file.unlink()
        # Whoever opened it would wait.
        os.mkfifo(file)
    assert report(tmp_path, rows(), run_record()).all("img") == []


def test_without_truth_or_rows_there_is_still_a_report(tmp_path):
    run = run_record(["mnsf"], truth=None)
    page = report(tmp_path, rows_without_truth(), run, kept(methods=["mnsf"]))
    for text in ("0.200", "no true flow"):
        assert text in page.text
    assert "EPE" not in page.text
    (image,) = page.all("img")
    assert "from the moved points to the next sweep" in image["alt"]
    assert "There are no results yet." in report(tmp_path, [], run_record()).text


def test_text_of_others_is_no_markup(tmp_path):
    bad = "command:<script>alert(1)</script>\"'&"
    found = [row(1, bad, 0.1, recording=bad), failed(2, bad, bad, recording=bad)]
    page = report(tmp_path, found, run_record([bad], recordings=[recording(bad)]))
    assert page.all("script") == []
    assert bad in page.text


def test_many_methods_in_any_order_give_the_same_file(tmp_path):
    methods = [f"method {k}" for k in range(30)]
    found = [*rows(), *(row(1, m, 0.1) for m in methods)]
    page = report(tmp_path, found, run_record([*METHODS, *methods]))
    assert all(method in page.text for method in methods)
    assert report(tmp_path, found[::-1], run_record([*METHODS, *methods])).source == page.source
