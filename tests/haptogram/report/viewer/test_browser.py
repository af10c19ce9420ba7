"""The view in a real browser: its field, its marks, its controls."""

from __future__ import annotations

import re
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haptogram.acoustics import (
    AcousticModel,
    Calibration,
    CircularPiston,
    Drive,
    Medium,
    PointSource,
    RectangularPiston,
    Transducer,
    TransducerArray,
    pressure,
)
from haptogram.machine.provenance import UNSTATED
from haptogram.report.formats.html import write_document_page
from haptogram.report.viewer.frames import LATE, ViewerFrame
from haptogram.report.viewer.scene import ViewerScene, view_document

_FIELD = """(points) => {
  const { scene, picture: { field } } = haptogramViewer;
  const found = field.pressure(field.propagators(Float64Array.from(points)), 0);
  return [...found];
}"""


def _turn(degrees: float) -> np.ndarray[Any, Any]:
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]])


def _face_to_face() -> TransducerArray:
    low = TransducerArray.grid(5, 5, pitch_m=0.0105)
    high = low.moved(_turn(180.0), (0.0, 0.0, 0.2))
    return TransducerArray.from_positions(
        np.concatenate([low.positions_m, high.positions_m]),
        np.concatenate([low.normals, high.normals]),
    )


def _model(array: TransducerArray, transducer: Transducer) -> AcousticModel:
    return AcousticModel(array, Medium.air(25.0), transducer)


_GRID = TransducerArray.grid(6, 4, pitch_m=0.01)
_PISTON, _POINT = Transducer(CircularPiston()), Transducer(PointSource())
_RECTANGLE = Transducer(RectangularPiston(0.011, 0.006, width_axis=(1.0, 0.7, 0.2)))
_MODELS = {
    f"{shape}, {kind}": _model(array, transducer)
    for shape, array in {
        "flat": _GRID,
        "tilted and moved": _GRID.moved(_turn(35.0), (0.02, -0.03, 0.01)),
        "facing down": _GRID.moved(_turn(180.0), (0.0, 0.0, 0.25)),
        "face to face": _face_to_face(),
        "one element": TransducerArray.grid(1, 1),
    }.items()
    for kind, transducer in {
        "pistons": _PISTON,
        "point sources": _POINT,
        "rectangles": _RECTANGLE,
    }.items()
}


def _calibrated() -> AcousticModel:
    model = _model(_GRID, _PISTON)
    rng = np.random.default_rng(5)
    return model.calibrated(
        Calibration(
            gain=rng.uniform(0.5, 1.2, 24),
            phase_rad=rng.uniform(-2.0, 2.0, 24),
            positions_m=_GRID.positions_m,
        )
    )


_MODELS["calibrated"] = _calibrated()


def _scene_page(tmp_path: Path, scene: ViewerScene) -> str:
    path = tmp_path / "view.html"
    write_document_page(path, view_document(scene, title="A view", lead=["Of a test."]), UNSTATED)
    return path.as_uri()


@pytest.mark.parametrize("name", _MODELS)
def test_field_of_the_page_is_that_of_the_reference(
    name: str, tmp_path: Path, open_page: Callable[..., Any]
) -> None:
    model = _MODELS[name]
    rng = np.random.default_rng(3)
    count = model.array.count
    drive = Drive(
        rng.integers(0, 256, count, dtype=np.uint8), rng.integers(0, 256, count, dtype=np.uint8)
    )
    page = open_page(
        _scene_page(tmp_path, ViewerScene.of(model, [ViewerFrame(number=0, drive=drive)]))
    )
    centre, facing = model.array.centre_m, model.array.facing
    points = centre + 0.1 * facing + rng.uniform(-0.08, 0.08, (200, 3))
    expected = np.abs(pressure(model, drive.weights(), points)) / np.sqrt(2.0)
    found = np.array(page.evaluate(_FIELD, (1e3 * points).ravel().tolist()))
    assert expected.max() > 10.0
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-3 * expected.max())


def _run_of_four() -> ViewerScene:
    """Two frames on target, one lost, one late."""
    model = AcousticModel.default(8, 8)
    drives = [Drive(np.full(64, code, np.uint8), np.full(64, 255, np.uint8)) for code in range(4)]
    places = [(0.02, 0.01, 0.1), (0.0, 0.0, 0.12), (-0.02, 0.0, 0.1), (0.0, -0.02, 0.11)]
    common = [
        {"number": n, "target_m": place, "due_us": 1000 * n} for n, place in enumerate(places)
    ]
    seen = [
        {
            "latched_us": 1000 * n + 25,
            "received_us": 1000 * n - 250 * (4 - n),
            "found_m": place,
            "drive": drive,
            "pressure_pa": 900.0,
        }
        for n, (place, drive) in enumerate(zip(places, drives, strict=True))
    ]
    frames = [
        ViewerFrame(**common[0], **seen[0], status="on target"),
        ViewerFrame(**common[1], **seen[1], status="on target"),
        ViewerFrame(**common[2], status="lost", text="frame 2: lost <b>x</b>"),
        ViewerFrame(**common[3], **seen[3], status="on target", timing=LATE),
    ]
    return ViewerScene.of(model, frames, counters={"lost": 1})


@pytest.fixture
def page(tmp_path: Path, open_page: Callable[..., Any]) -> Any:
    page = open_page(_scene_page(tmp_path, _run_of_four()))
    page.evaluate("() => haptogramViewer.show(0)")
    return page


def test_a_scene_without_a_focus_reaches_before_the_array(
    tmp_path: Path, open_page: Callable[..., Any]
) -> None:
    drive = Drive(np.zeros(24, np.uint8), np.full(24, 255, np.uint8))
    scene = ViewerScene.of(_MODELS["facing down, pistons"], [ViewerFrame(number=0, drive=drive)])
    page = open_page(_scene_page(tmp_path, scene))
    bounds = page.evaluate("() => haptogramViewer.picture.bounds")
    assert bounds["low"][2] < 250.0 - 50.0  # the array lies at 250 mm and looks down
    assert bounds["high"][2] < 270.0
    scale = page.evaluate("() => haptogramViewer.picture.scalePa")
    assert scale > 10.0  # of the field that was drawn, as no focus gives one
    assert page.locator("[data-part=pressure-high]").inner_text() == f"{scale:g} Pa RMS"


def test_the_first_frame_that_wants_attention_is_shown_first(
    tmp_path: Path, open_page: Callable[..., Any]
) -> None:
    page = open_page(_scene_page(tmp_path, _run_of_four()))
    assert _table(page)["status"] == "lost"
    assert page.evaluate("() => haptogramViewer.frame") == 2


def _table(page: Any) -> dict[str, str]:
    rows = page.locator("[data-part=frame] tr").all()
    return {row.locator("th").inner_text(): row.locator("td").inner_text() for row in rows}


def _pixel(page: Any, place: str) -> list[int]:
    """Colour at the place of a focus in the picture."""
    return page.evaluate(
        """(name) => {
          const { picture, scene, frame } = haptogramViewer;
          const [x, y] = haptogramViewer.pixelOf(scene.row(name, frame));
          const at = [x, y].map((value) => Math.round(value * picture.ratio));
          return [...picture.context.getImageData(...at, 1, 1).data.slice(0, 3)];
        }""",
        place,
    )


def test_focus_lies_at_its_place_in_pixels(page: Any) -> None:
    for number in (0, 1, 3):
        page.evaluate("(frame) => haptogramViewer.show(frame)", number)
        red, green, blue = _pixel(page, "found_mm")
        assert blue > 120  # the blue of a focus that was found, and none of the field's
        assert red < 60
        assert green > 80


def test_table_tells_the_frame_and_leaves_out_what_is_not_known(page: Any) -> None:
    page.evaluate("() => haptogramViewer.show(0)")
    table = _table(page)
    assert table["frame"] == "0 (1 of 4)"
    assert table["status"] == "on target"
    assert table["target x, y, z"] == "20.00, 10.00, 100.00 mm"
    assert table["pressure at the focus"] == "900 Pa RMS"
    page.evaluate("() => haptogramViewer.show(2)")
    table = _table(page)
    assert table["status"] == "lost"
    assert "focus x, y, z" not in table
    assert "arrival margin" not in table
    assert "pressure at the focus" not in table
    assert page.locator("[data-part=text]").inner_text() == "frame 2: lost <b>x</b>"


def test_lost_and_late_frames_show_on_the_time_line(page: Any) -> None:
    colours = page.evaluate(
        """() => {
          const { timeline } = haptogramViewer;
          const ratio = devicePixelRatio;
          return timeline.times.map((t) => {
            const x = Math.round(timeline.x(t) * ratio);
            return [...timeline.context.getImageData(x, 15 * ratio, 1, 1).data];
          });
        }"""
    )
    assert colours[1][3] == 0  # on target: a short tick
    assert colours[2][:3] == [0xB0, 0x56, 0x8A]  # lost
    assert colours[3][:3] == [0xA8, 0x74, 0x00]  # late
    assert page.locator("[data-part=trouble-count]").inner_text() == "2"
    buttons = page.locator("[data-part=troubles] button")  # one for each kind, not for each frame
    assert buttons.all_inner_texts() == ["next of 1: lost", "next of 1: on target, late"]
    for number in (3, 3, 2):  # behind the last one follows the first
        buttons.nth(0 if number == 2 else 1).click()
        assert page.evaluate("() => haptogramViewer.frame") == number


def test_arrival_margins_stand_on_the_time_line(page: Any) -> None:
    """The first frame came 1 ms before its time, the last one 0.25 ms, the third never."""
    heights = page.evaluate(
        """() => {
          const { timeline } = haptogramViewer;
          const ratio = devicePixelRatio;
          const top = 24 * ratio;
          const height = timeline.canvas.height - top;
          return timeline.times.map((t) => {
            const x = Math.round(timeline.x(t) * ratio);
            const column = timeline.context.getImageData(x + 2, top, 1, height).data;
            return column.filter((alpha, at) => at % 4 === 3 && alpha > 0).length / ratio;
          });
        }"""
    )
    longest = heights[0]
    assert longest > 30
    assert heights == pytest.approx([longest, 0.75 * longest, 0.0, 0.25 * longest], abs=2.0)
    assert _table(page)["arrival margin"] == "1.000 ms"
    assert page.locator("[data-part=longest]").inner_text() == "1.00 ms"


def test_controls_step_play_pause_and_jump(page: Any) -> None:
    shown = "() => haptogramViewer.frame"
    page.click("[data-part=forward]")
    page.click("[data-part=forward]")
    page.click("[data-part=back]")
    assert page.evaluate(shown) == 1
    page.locator("[data-part=timeline]").focus()
    for key, frame in (("End", 3), ("ArrowLeft", 2), ("Home", 0), ("ArrowRight", 1)):
        page.keyboard.press(key)
        assert page.evaluate(shown) == frame
    page.click("text=next of 1: lost")
    assert page.evaluate(shown) == 2
    page.evaluate("() => haptogramViewer.show(0)")
    page.select_option("[data-part=speed]", "0.1")
    page.click("[data-part=play]")
    page.wait_for_function("() => haptogramViewer.frame === 3 && !haptogramViewer.playing")
    page.select_option("[data-part=speed]", "0.001")
    page.click("[data-part=play]")
    assert page.locator("[data-part=play]").inner_text() == "Pause"
    page.click("[data-part=play]")
    assert page.evaluate("() => haptogramViewer.playing") is False
    assert page.evaluate(shown) < 3


def test_every_control_is_reached_and_worked_by_keyboard(page: Any) -> None:
    shown, playing = "() => haptogramViewer.frame", "() => haptogramViewer.playing"
    reached, outlines = [], []
    page.locator("[data-part=picture]").focus()
    for _ in range(14):
        at = page.evaluate(
            "() => [document.activeElement.dataset.part, getComputedStyle(document.activeElement)"
            ".outlineStyle]"
        )
        reached.append(at[0])
        outlines.append(at[1])
        page.keyboard.press("Tab")
    wanted = ["picture", "timeline", "play", "back", "forward", "speed", "axis", "at", "follow"]
    assert [name for name in reached if name in wanted] == wanted
    assert {"trail", "decibels", "reset"} <= set(reached)
    assert set(outlines[1 : len(wanted)]) == {"solid"}
    slider = page.locator("[data-part=timeline]")
    page.select_option("[data-part=speed]", "0.001")
    for part in ("timeline", "picture"):
        page.locator(f"[data-part={part}]").focus()
        page.keyboard.press(" ")
        assert page.evaluate(playing) is True
        page.keyboard.press(" ")
        assert page.evaluate(playing) is False
    slider.focus()
    page.keyboard.press("End")
    assert slider.get_attribute("aria-valuenow") == "3"
    assert slider.get_attribute("aria-valuemax") == "3"
    assert "on target, late" in (slider.get_attribute("aria-valuetext") or "")
    page.locator("[data-part=picture]").focus()
    turned = page.evaluate("() => haptogramViewer.picture.camera.azimuth")
    page.keyboard.press("ArrowLeft")
    assert page.evaluate("() => haptogramViewer.picture.camera.azimuth") > turned
    assert page.evaluate(shown) == 3
    page.keyboard.press("0")
    assert page.evaluate("() => haptogramViewer.picture.camera.azimuth") == turned


def test_everything_with_a_meaning_has_a_name(page: Any) -> None:
    nameless = page.evaluate(
        """() => [...document.querySelectorAll(".viewer :is(button, input, select, canvas)")]
          .filter((e) => !e.getAttribute("aria-label") && !e.textContent.trim())
          .filter((e) => !e.labels?.length)
          .map((e) => e.outerHTML)"""
    )
    assert nameless == []


def test_an_address_shows_a_frame_that_no_table_lists(
    tmp_path: Path, open_page: Callable[..., Any]
) -> None:
    address = _scene_page(tmp_path, _run_of_four())
    for kind in ("view", "frame"):
        page = open_page(f"{address}#{kind}-2")
        assert page.evaluate("() => haptogramViewer.frame") == 2


@pytest.mark.parametrize("array", [_GRID, TransducerArray.grid(1, 1), _face_to_face()])
@pytest.mark.parametrize("size", [(1280, 900), (400, 900)])
def test_all_that_there_is_fills_the_picture_and_lies_in_it(
    array: TransducerArray, size: tuple[int, int], tmp_path: Path, open_page: Callable[..., Any]
) -> None:
    drive = Drive(np.zeros(array.count, np.uint8), np.full(array.count, 255, np.uint8))
    frame = ViewerFrame(number=0, drive=drive, target_m=(0.0, 0.0, 0.12))
    scene = ViewerScene.of(AcousticModel(array, Medium.air(20.0), _PISTON), [frame])
    view = {"width": size[0], "height": size[1]}
    page = open_page(_scene_page(tmp_path, scene), viewport=view)
    corners, canvas = page.evaluate(
        """() => {
          const { bounds: { low, high }, view } = haptogramViewer.picture;
          const corner = (n) => [0, 1, 2].map((axis) => (n >> axis & 1 ? high : low)[axis]);
          const places = [...Array(8).keys()].map((n) => haptogramViewer.pixelOf(corner(n)));
          return [places, [view.width, view.height]];
        }"""
    )
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    assert (low >= 0).all()
    assert (high <= canvas).all()
    assert max((high - low) / canvas) == pytest.approx(0.94, abs=0.01)


_CONTRASTS = """() => {
  const channel = (v) => (v <= 10 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4);
  const bright = (colour) => {
    const [r, g, b] = colour.match(/[\\d.]+/g).map(Number);
    return 0.2126 * channel(r) + 0.7152 * channel(g) + 0.0722 * channel(b);
  };
  const ground = (e) => {
    for (let at = e; at; at = at.parentElement) {
      const colour = getComputedStyle(at).backgroundColor;
      if (!colour.endsWith(", 0)")) return colour;
    }
    return "rgb(255, 255, 255)";
  };
  const found = [];
  for (const e of document.querySelectorAll("body *")) {
    const texts = [...e.childNodes].filter((n) => n.nodeType === 3 && n.textContent.trim());
    if (!texts.length || !e.offsetParent) continue;
    const [one, other] = [getComputedStyle(e).color, ground(e)].map(bright);
    const ratio = (Math.max(one, other) + 0.05) / (Math.min(one, other) + 0.05);
    const least = e.className.startsWith?.("mark-") ? 3 : 4.5;
    if (ratio < least) found.push([e.outerHTML.slice(0, 80), ratio]);
  }
  return found;
}"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_texts_and_marks_have_the_contrast_of_wcag_aa(
    scheme: str, tmp_path: Path, open_page: Callable[..., Any]
) -> None:
    page = open_page(_scene_page(tmp_path, _run_of_four()), color_scheme=scheme)
    assert page.evaluate(_CONTRASTS) == []


def test_plane_is_moved_by_slider_handle_and_axis(page: Any) -> None:
    at = "() => haptogramViewer.picture.plane.at"
    page.evaluate("() => haptogramViewer.show(1)")
    assert page.evaluate(at) == pytest.approx(120.0)  # it follows the focus
    handle = page.locator("[data-part=handle]").bounding_box()
    page.mouse.move(handle["x"] + 14, handle["y"] + 14)
    page.mouse.down()
    page.mouse.move(handle["x"] + 14, handle["y"] + 54)
    page.mouse.up()
    assert page.evaluate(at) < 110.0
    page.evaluate("() => haptogramViewer.show(0)")
    assert page.evaluate(at) < 110.0  # it no longer follows
    page.select_option("[data-part=axis]", "0")
    assert page.evaluate("() => haptogramViewer.picture.plane.axis") == 0


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [400, 1280])
def test_page_fits_the_screen(
    scheme: str, width: int, tmp_path: Path, open_page: Callable[..., Any]
) -> None:
    settings = {"viewport": {"width": width, "height": 900}, "color_scheme": scheme}
    page = open_page(_scene_page(tmp_path, _run_of_four()), **settings)
    assert page.evaluate("() => document.documentElement.scrollWidth") <= width
    boxes = [b.bounding_box() for b in page.locator(".viewer button, .viewer select").all()]
    assert all(box["x"] >= 0 and box["x"] + box["width"] <= width for box in boxes)


def test_troubles_are_counted_when_old_frames_are_dropped(page: Any) -> None:
    """Half of the frames are late or lost; 10 000 are kept."""
    told = page.evaluate(
        """() => {
          const { scene } = haptogramViewer;
          const copy = () => new scene.constructor(scene.header, structuredClone(scene.columns));
          const told = [];
          for (let doubled = 0; doubled < 13; doubled += 1) {
            haptogramViewer.append(copy());
            told.push(Number(document.querySelector("[data-part=trouble-count]").textContent));
          }
          return [scene.frames, ...told.slice(-3)];
        }"""
    )
    assert told == [10000, 4096, 4096 + 4096, 4096 + 4096 + 5000]


def test_scene_that_cannot_be_read_is_told(tmp_path: Path, open_page: Callable[..., Any]) -> None:
    path = tmp_path / "view.html"
    write_document_page(path, view_document(_run_of_four(), title="A view", lead=[]), UNSTATED)
    text = path.read_text()
    start = text.index('id="scene">') + len('id="scene">')
    path.write_text(text[:start] + text[start + 40 :])
    page = open_page(path.as_uri())
    assert "cannot show the view" in page.locator("[data-part=failure]").inner_text()


def test_page_loads_nothing_from_elsewhere(tmp_path: Path) -> None:
    path = tmp_path / "view.html"
    write_document_page(path, view_document(_run_of_four(), title="A view", lead=[]), UNSTATED)
    assert not re.search(r"(?:src|href)=\"(?!data:,)|https?://|@import|url\(", path.read_text())


def test_colour_maps_are_those_of_the_pictures() -> None:
    matplotlib = pytest.importorskip("matplotlib")
    script = files("haptogram.report").joinpath("templates/viewer/colours.js").read_text()
    for constant, name in (("PHASE_STOPS", "twilight"), ("PRESSURE_STOPS", "cividis")):
        declared = script.split(f"const {constant}")[1].split(";")[0]
        stops = re.findall("[0-9a-f]{6}", "".join(re.findall('"([0-9a-f]+)"', declared)))
        found = np.array([[int(stop[i : i + 2], 16) for i in (0, 2, 4)] for stop in stops])
        expected = matplotlib.colormaps[name](np.linspace(0.0, 1.0, len(stops)))[:, :3]
        np.testing.assert_allclose(found, 255.0 * expected, atol=1.0)
