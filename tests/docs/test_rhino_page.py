"""The page on two RHINO robots: its figures are recomputed, its sentences hold, and the committed page has both."""

import importlib
import sys
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / "scripts"))
figures = importlib.import_module("rhino_figures")
rhino_page = importlib.import_module("rhino_page")
rhino_pictures = importlib.import_module("rhino_pictures")
skeleton = importlib.import_module("ablation_page").skeleton

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def results() -> "figures.Results":
    return figures.compute()


def test_every_sentence_of_the_page_fits_the_figures(results: "figures.Results") -> None:
    assert rhino_page.misfits(results) == []


def test_the_committed_page_is_what_make_rhino_writes(results: "figures.Results") -> None:
    committed = (ROOT / "docs" / "rhino.md").read_text(encoding="utf-8")
    assert skeleton(committed) == skeleton(rhino_page.page(results))
    for name, text in rhino_pictures.pictures(results).items():
        picture = (ROOT / "docs" / "pictures" / name).read_text(encoding="utf-8")
        assert len(picture) == pytest.approx(len(text), rel=0.02)


def test_fig_6_has_ten_curves_over_the_lap_and_the_map_a_mark_and_a_word_for_every_colour(
    results: "figures.Results",
) -> None:
    joints, reachable = (ElementTree.fromstring(text) for text in rhino_pictures.pictures(results).values())
    assert len(joints.findall(f"{SVG}polyline")) == 10
    assert all(len(line.get("points", "").split()) == 201 for line in joints.findall(f"{SVG}polyline"))
    texts = [each.text for each in reachable.findall(f"{SVG}text")]
    colours = {(each.get("fill"), each.get("fill-opacity")) for each in reachable.findall(f"{SVG}rect")}
    legend = [each for each in reachable.findall(f"{SVG}rect") if each.get("width") == "14"]
    assert {(each.get("fill"), each.get("fill-opacity")) for each in legend} == colours
    assert {"out of reach", "singular", "1  the master's base", "3  B, 0.3 m from A"} <= set(texts)


def test_a_sentence_that_no_longer_holds_is_named(results: "figures.Results") -> None:
    wrong = replace(results, way_of_b_m=(0.2, 0.1))
    assert [each.text[:39] for each in rhino_page.misfits(wrong)] == ["A grasp nearer to the master is better."]
