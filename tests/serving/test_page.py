"""The page in Chromium: by mouse, by keyboard alone, on a phone, and as one file from disk."""

from __future__ import annotations

import itertools
import json
import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cartier.home import Home
from cartier.serving import page
from cartier.serving.page import one_file, view
from serving.browsing import chromium
from serving.conftest import Beside, Server

STYLE = (page.WEB / "style.css").read_text()


# --- without a browser -----------------------------------------------------------------------------------------------


def luminance(hexadecimal: str) -> float:
    parts = [int(hexadecimal[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    r, g, b = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts)
    return 0.2126 * r + 0.7152 * g + 0.0722 * b


@pytest.mark.parametrize("theme", [":root", ":root.dark"])
def test_contrasts_are_those_of_wcag_aa(theme: str) -> None:
    block = STYLE[STYLE.index(theme + " {") :].partition("}")[0]
    colours = dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6})", block))
    texts = {"ink": ("page", "panel", "tint"), "muted": ("page", "panel", "tint"), "accent": ("panel",),
             "on-accent": ("accent",), "label": ("floor", "low"), "panel": ("ink",)}  # fmt: skip
    marks = {"field": ("panel",), "way": ("floor",), "chosen": ("floor",), "wall": ("floor",), "accent": ("page",)}
    for least, pairs in ((4.5, texts), (3.0, marks)):
        for one, others in pairs.items():
            for other in others:
                light, dark = sorted((luminance(colours[one]), luminance(colours[other])), reverse=True)
                assert (light + 0.05) / (dark + 0.05) >= least, (one, other)


def test_the_view_holds_what_the_home_holds(home: Path) -> None:
    mapped = Home.load(home)
    told = json.loads(json.dumps(view(mapped), allow_nan=False))
    grid = told["grid"]
    cells = list(
        itertools.chain.from_iterable([code] * count for code, count in zip(*[iter(grid["cells"])] * 2, strict=True))
    )
    assert mapped.grid is not None
    kinds = {-1: 0, 0: 1, 100: 2}
    assert [code % 3 for code in cells] == [kinds[int(v)] for v in mapped.grid.cells.ravel()]
    assert sum(code >= 3 for code in cells) == sum(len(room.cells) for room in mapped.rooms)
    assert {row["id"] for row in told["objects"]} == {obj.id for obj in mapped.objects}


def test_one_file_is_whole_and_may_load_nothing(home: Path) -> None:
    evil = "</script><script>alert(1)</script>"
    named, _ = Home.load(home).correct("name", "mug", name=evil)
    html = one_file(named).decode()
    assert evil not in html and "\\u003c/script>" in html
    policy = re.search(r'Content-Security-Policy" content="([^"]+)"', html)
    assert (
        policy is not None
        and "default-src 'none'" in policy[1]
        and "unsafe" not in policy[1]
        and "connect-src" not in policy[1]
    )
    assert not re.search(r"(?:src|href)=\"(?!data:|#)", html) and html.count("<script") == 2
    assert set(re.findall(r"https?://[\w./]+", html)) <= {"http://www.w3.org/2000/svg"}
    assert len(html) < 3_000_000


def test_no_file_of_the_page_names_another_machine() -> None:
    for _, data in page.files().values():
        assert set(re.findall(rb"https?://[\w./]+", data)) <= {b"http://www.w3.org/2000/svg"}
        assert b"innerHTML" not in data and b"eval(" not in data and b"document.write" not in data


def test_a_home_without_a_floor_plan_is_shown_too(home: Path) -> None:
    bare = replace(Home.load(home), grid=None, rooms=())
    assert view(bare)["grid"] is None and b"home-data" in one_file(bare)


# --- in Chromium -----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as opened:
        yield opened


@pytest.fixture
def visit(browser: Any) -> Iterator[Callable[..., Any]]:
    """Opens a page. At the end its console must be empty, and it must have called no other server."""
    opened: list[tuple[Any, list[str], list[str], str]] = []

    def open_page(url: str, **options: Any) -> Any:
        tab = browser.new_context(**{"viewport": {"width": 1280, "height": 800}} | options).new_page()
        said: list[str] = []
        asked: list[str] = []
        tab.on("console", lambda message: said.append(f"{message.text} {message.location.get('url')}"))
        tab.on("pageerror", lambda error: said.append(str(error)))
        tab.on("request", lambda request: asked.append(request.url))
        tab.goto(url)
        tab.wait_for_selector("html[data-ready]")
        opened.append((tab, said, asked, url))
        tab.asked = asked
        return tab

    yield open_page
    for tab, said, asked, url in opened:
        assert not [line for line in said if "401" not in line], said
        own = url if url.startswith("file:") else url.rstrip("/") + "/"
        assert all(each.startswith((own, "data:", "blob:")) for each in asked), asked
        tab.context.close()


def card(tab: Any) -> str:
    return str(tab.inner_text("#card h2"))


def test_ask_and_see_goal_path_and_photo(home: Path, start: Callable[..., Server], visit: Callable[..., Any]) -> None:
    tab = visit(start("serve", home).url)
    tab.fill("#words", "my feet hurt, let me sit down")
    tab.press("#words", "Enter")
    tab.wait_for_selector("#card .photo i")
    assert card(tab).startswith("chair") and "Chair" in tab.inner_text("#turns li:last-child")
    assert tab.locator("#plan .way").count() == 1 and tab.locator("#plan .object.chosen").count() == 1
    mark, photo = (tab.locator(f"#card .photo {part}").bounding_box() for part in ("i", "img"))
    assert mark["x"] >= photo["x"] - 1 and mark["x"] + mark["width"] <= photo["x"] + photo["width"] + 1


def test_click_rename_move_forget_undo_and_reload(
    home: Path, beside: Callable[..., Beside], visit: Callable[..., Any]
) -> None:
    tab = visit(beside("serve", home).url)

    def choose(label: str) -> None:
        number = next(t.id for t in Home.load(home).objects if t.label == label)
        tab.locator(f'#plan .object[data-id="{number}"]').click(position={"x": 2, "y": 2})
        tab.wait_for_function("label => document.querySelector('#card h2')?.textContent.includes(label)", arg=label)

    assert tab.locator("#undo").is_hidden()
    choose("chair")
    tab.click("text=Rename")
    tab.keyboard.type("Grandpa's <b>throne</b>")
    tab.keyboard.press("Enter")
    tab.wait_for_selector("#toast:has-text('is called')")
    assert card(tab).startswith("Grandpa's <b>throne</b>") and Home.load(home).objects[0].names == (
        "Grandpa's <b>throne</b>",
    )
    tab.click("text=Move")
    box = tab.locator("#plan").bounding_box()
    tab.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    tab.wait_for_selector("#toast:has-text('stands at')")
    x, y = tab.evaluate("[plan.view.x + plan.view.w / 2, -(plan.view.y + plan.view.h / 2)]")
    moved = next(t for t in Home.load(home).objects if t.names)
    assert abs(moved.position[0] - x) < 0.03 and abs(moved.position[1] - y) < 0.03, "the pixel that was clicked"
    tab.click("text=Forget")
    tab.wait_for_selector("#toast:has-text('is forgotten')")
    assert "chair" not in Home.load(home).names and tab.locator("#card").is_hidden()
    tab.reload()
    tab.wait_for_selector("html[data-ready]")
    assert tab.inner_text("#count") == "2"
    for left in ("3", "3", "3"):
        tab.evaluate("document.getElementById('toast').hidden = true")
        tab.click("#undo")
        tab.wait_for_selector("#toast:has-text('undone')")
        assert tab.inner_text("#count") == left
    assert tab.locator("#undo").is_hidden() and not Home.load(home).objects[0].names


def test_confirm_relabel_split_merge_add_and_the_home_s_name(
    home: Path, beside: Callable[..., Beside], visit: Callable[..., Any]
) -> None:
    tab = visit(beside("serve", home).url)
    chair = next(t for t in Home.load(home).objects if t.label == "chair")

    def told(words: str) -> Home:
        tab.wait_for_selector(f"#toast:has-text('{words}')")
        tab.evaluate("document.getElementById('toast').hidden = true")
        return Home.load(home)

    def objects(now: Home) -> list[str]:
        return sorted(t.label for t in now.objects if t.confirmed)

    before = objects(Home.load(home))
    tab.locator(f'#plan .object[data-id="{chair.id}"]').click(position={"x": 2, "y": 2})
    tab.click("button:text-is('It is there')")
    assert next(t for t in told("is there").objects if t.id == chair.id).by_person
    assert "a person said" in tab.inner_text("#card") and tab.locator("button:text-is('It is there')").count() == 0
    tab.click("text=It is a …")
    tab.keyboard.type("Throne")
    tab.keyboard.press("Enter")
    assert "throne" in objects(told("is labelled throne")) and card(tab).startswith("throne")
    tab.click("text=It is two")
    tab.click("#card .doing >> text=Save")
    assert objects(told("is two")).count("throne") == 2
    tab.click("text=Same as …")
    tab.click("#card .doing >> text=Save")
    assert objects(told("are one")).count("throne") == 1, "the nearest is offered first"
    tab.click("#tab-objects")
    tab.click("#add")
    tab.keyboard.type("vase")
    box = tab.locator("#plan").bounding_box()
    tab.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    vase = next(t for t in told("is added").objects if t.label == "vase")
    x, y = tab.evaluate("[plan.view.x + plan.view.w / 2, -(plan.view.y + plan.view.h / 2)]")
    assert abs(vase.position[0] - x) < 0.03 and abs(vase.position[1] - y) < 0.03, "the pixel that was clicked"
    tab.locator(f'#list button[data-id="{vase.id}"]').click()
    assert card(tab).startswith("vase") and tab.locator("#card .photo img").count() == 0
    tab.click("#name-home")
    tab.keyboard.type("Ben's flat")
    tab.keyboard.press("Enter")
    assert told("is called Ben").name == tab.inner_text("#title") == "Ben's flat"
    for _ in range(6):
        tab.click("#undo")
        told("undone")
    assert tab.locator("#undo").is_hidden() and objects(Home.load(home)) == before


def test_the_keyboard_alone_suffices(home: Path, beside: Callable[..., Beside], visit: Callable[..., Any]) -> None:
    tab = visit(beside("serve", home).url)
    keys = tab.keyboard

    def walk_to(selector: str) -> None:
        for _ in range(40):
            if tab.evaluate("s => document.activeElement?.matches(s)", selector):
                outline = tab.evaluate("getComputedStyle(document.activeElement).outlineStyle")
                assert outline == "solid", f"the focus of {selector} is seen"
                return
            keys.press("Tab")
        raise AssertionError(f"no way to {selector} by keyboard")

    keys.press("Tab")
    keys.press("Enter")  # the skip link
    assert tab.evaluate("document.activeElement.id") == "words"
    walk_to("#tab-talk")
    keys.press("ArrowRight")
    walk_to("#search")
    keys.type("mug")
    walk_to("#list button[data-id]")
    keys.press("Enter")
    tab.wait_for_function("document.querySelector('#card h2')?.textContent.startsWith('mug')")
    walk_to("#card .doing button")
    keys.press("Enter")
    keys.type("Ayo's mug")
    keys.press("Enter")
    tab.wait_for_selector("#toast:has-text('is called')")
    assert tab.evaluate("document.activeElement.textContent") == "Rename", "the focus stays where one was"
    walk_to("#undo")
    keys.press("Enter")
    tab.wait_for_selector("#toast:has-text('undone')")
    assert tab.evaluate("document.activeElement.id") == "flat"
    walk_to("#plan")
    before = tab.get_attribute("#plan", "viewBox")
    keys.press("+")
    keys.press("ArrowLeft")
    assert tab.get_attribute("#plan", "viewBox") != before
    keys.press("Escape")
    assert tab.locator("#card").is_hidden()
    unnamed = tab.evaluate(
        "[...document.querySelectorAll('button, input, select')].filter(e => !(e.getAttribute('aria-label')"
        " || e.textContent.trim() || e.labels?.length)).map(e => e.outerHTML)"
    )
    assert unnamed == [], "a screen reader has a name for everything"


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_phone_s_width_and_its_scheme(
    mapped: Path, beside: Callable[..., Beside], visit: Callable[..., Any], scheme: str
) -> None:
    tab = visit(
        beside("serve", mapped).url, viewport={"width": 360, "height": 740}, color_scheme=scheme, has_touch=True
    )
    assert tab.evaluate("document.documentElement.classList.contains('dark')") is (scheme == "dark")
    tab.click("#tab-objects")
    tab.locator("#list button[data-id]").first.click()
    tab.wait_for_selector("#card .photo img")
    assert tab.evaluate("document.documentElement.scrollWidth") <= 360
    small = tab.evaluate(
        "[...document.querySelectorAll('button:not(.pen), select')].map(e => e.getBoundingClientRect())"
        ".filter(r => r.width && r.height < 34).length"
    )
    assert small == 0, "fingers are wide"


def unsure(home: Path, label: str = "mug") -> int:
    """Make the object of a label tentative in a saved home; returns its id."""
    mapped = Home.load(home)
    doubted = [replace(t, confirmed=False, probability=0.3) if t.label == label else t for t in mapped.objects]
    replace(mapped, objects=tuple(doubted), store=None, corrected=None).save(home.with_name("doubted"))
    shutil.rmtree(home)
    home.with_name("doubted").rename(home)
    return next(t.id for t in doubted if t.label == label)


def test_a_phone_s_keyboard_covers_neither_the_field_nor_the_evidence(
    home: Path, beside: Callable[..., Beside], visit: Callable[..., Any]
) -> None:
    tab = visit(beside("serve", home).url, viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
    tab.fill("#words", "I want to sit down")
    tab.press("#words", "Enter")
    tab.wait_for_selector("#card .photo i")
    for height in (844, 480):  # without the keyboard, and with it
        tab.set_viewport_size({"width": 390, "height": height})
        tab.wait_for_function(
            "h => document.documentElement.classList.contains('typing') === (h < 560)"
            " && document.body.offsetHeight === h",
            arg=height,
        )
        for part in ("#words", "#card .photo", "#plan"):
            box = tab.locator(part).bounding_box()
            assert box["y"] >= 0 and box["y"] + box["height"] <= height and box["height"] > 30, (part, box)
            seen = "([x, y, s]) => document.elementFromPoint(x, y)?.closest(s) !== null"
            middle = [box["x"] + box["width"] / 2, box["y"] + box["height"] / 2, part]
            assert tab.evaluate(seen, middle), f"nothing lies over {part}"


def test_names_on_the_plan_do_not_collide(home: Path, beside: Callable[..., Beside], visit: Callable[..., Any]) -> None:
    tab = visit(beside("serve", home).url, viewport={"width": 390, "height": 844})
    tab.evaluate("choose(data.objects[0].id)")
    boxes = tab.evaluate("[...document.querySelectorAll('#plan text')].map(t => t.getBoundingClientRect().toJSON())")
    frame = tab.locator("#plan").bounding_box()
    assert len(boxes) >= 3
    for k, a in enumerate(boxes):
        assert a["left"] >= frame["x"] - 1 and a["right"] <= frame["x"] + frame["width"] + 1
        for b in boxes[:k]:
            apart = a["right"] <= b["left"] or b["right"] <= a["left"] or a["bottom"] <= b["top"] + 3
            assert apart or b["bottom"] <= a["top"] + 3, (a, b)


def test_an_uncertain_answer_shows_its_photo_and_asks(
    home: Path, beside: Callable[..., Beside], visit: Callable[..., Any]
) -> None:
    number = unsure(home)
    tab = visit(beside("serve", home).url)
    assert tab.locator(f'#plan [data-id="{number}"]').is_hidden(), "hidden until asked for"
    tab.fill("#words", "where is the mug?")
    tab.press("#words", "Enter")
    tab.wait_for_selector("#card .photo i")
    assert "Is this a mug?" in tab.inner_text("#card .doubt") and card(tab).startswith("mug ?")
    assert tab.locator(f'#plan [data-id="{number}"]').is_visible()
    assert tab.locator("#card button:text-is('It is there')").count() == 0, "Yes says so"
    tab.click("#card .doubt .yes")
    tab.wait_for_selector("#toast:has-text('is there')")
    mug = next(t for t in Home.load(home).objects if t.id == number)
    assert mug.confirmed and mug.by_person and not card(tab).startswith("mug ?")
    assert tab.locator("#card .doubt").count() == 0 and "a person said" in tab.inner_text("#card")
    tab.click("#undo")
    tab.wait_for_selector("#toast:has-text('undone')")
    assert not next(t for t in Home.load(home).objects if t.id == number).confirmed
    tab.evaluate("id => choose(id)", number)
    tab.click("#card .doubt .no")
    tab.wait_for_selector("#toast:has-text('is forgotten')")
    assert number not in {t.id for t in Home.load(home).objects}


def test_a_correction_drops_what_was_asked_of_the_home_before(
    home: Path, beside: Callable[..., Beside], visit: Callable[..., Any]
) -> None:
    tab = visit(beside("serve", home).url)
    dropped: list[str] = []
    tab.on("requestfailed", lambda request: dropped.append(request.url))
    tab.route("**/goal?*", lambda route: None)  # the goal never comes
    tab.evaluate("choose(data.objects.find((t) => t.confirmed).id)")
    tab.click("#card button:text-is('Forget')")
    tab.wait_for_selector("#toast:has-text('is forgotten')")
    assert any("/goal?" in url for url in dropped)


def test_a_name_from_the_outside_is_only_text(
    home: Path, beside: Callable[..., Beside], visit: Callable[..., Any]
) -> None:
    Home.load(home).correct("name", "mug", name="<img src=x onerror=alert(1)>")
    tab = visit(beside("serve", home).url)
    tab.click("#tab-objects")
    assert tab.locator("#list img").count() == 0 and "<img src=x" in tab.inner_text("#list")


def test_a_server_with_a_token_asks_for_it(mapped: Path, beside: Callable[..., Beside], browser: Any) -> None:
    token = "correct-horse-battery-staple-42"
    server = beside("serve", mapped, CARTIER_TOKEN=token)
    tab = browser.new_context().new_page()
    tab.goto(server.url)
    for given in ("wrong", token):
        tab.wait_for_selector("#key[open]")
        tab.fill("#token", given)
        tab.keyboard.press("Enter")
    tab.wait_for_selector("html[data-ready]")
    assert tab.inner_text("#count") == "3" and token not in tab.url
    tab.context.close()


def test_one_file_from_disk_shows_finds_and_asks_nobody(home: Path, tmp_path: Path, visit: Callable[..., Any]) -> None:
    file = tmp_path / "home.html"
    file.write_bytes(one_file(Home.load(home)))
    tab = visit(file.as_uri())
    expectations = {"where is the mug?": "Mug", "my feet hurt": "Chair", "how many tables are there": "1 × table"}
    expectations["zzz"] = "No object"
    for words, expected in expectations.items():
        tab.fill("#words", words)
        tab.press("#words", "Enter")
        tab.wait_for_function("() => !document.querySelector('#turns li:last-child').textContent.startsWith('…')")
        assert expected in tab.inner_text("#turns li:last-child")
    tab.fill("#words", "mug")
    tab.press("#words", "Enter")
    tab.wait_for_selector("#card .photo i")
    assert tab.locator("#plan .way").count() == 1 and tab.locator("text=Rename").count() == 0
    assert [url for url in tab.asked if not url.startswith("data:")] == [file.as_uri()]


def test_an_object_in_3d_has_its_colour_where_it_should_be(
    home: Path, tmp_path: Path, visit: Callable[..., Any]
) -> None:
    file = tmp_path / "home.html"
    file.write_bytes(one_file(Home.load(home)))
    tab = visit(file.as_uri())
    tab.click("#solid")
    tab.wait_for_function("() => scene.gl && scene.canvas.width > 10")
    tab.uncheck("#points")
    top = """id => { const t = byId(id),
      [x, y] = scene.project([(t.low[0] + t.high[0]) / 2, (t.low[1] + t.high[1]) / 2, t.high[2]]),
      box = scene.canvas.getBoundingClientRect(), k = scene.canvas.width / box.width, pixel = new Uint8Array(4);
      scene.gl.readPixels(Math.round((x - box.left) * k), scene.canvas.height - 1 - Math.round((y - box.top) * k),
        1, 1, scene.gl.RGBA, scene.gl.UNSIGNED_BYTE, pixel);
      return { x, y, pixel: [...pixel], colour: colourOf(t) }; }"""
    table = next(t for t in Home.load(home).objects if t.label == "chair")
    seen = tab.evaluate(top, table.id)
    wanted = [int(seen["colour"][k : k + 2], 16) for k in (1, 3, 5)]
    shade = 0.62 + 0.38 * 0.9
    assert all(abs(got - shade * want) <= 12 for got, want in zip(seen["pixel"][:3], wanted, strict=True)), seen
    tab.mouse.click(seen["x"], seen["y"])
    assert card(tab).startswith("chair"), "what is drawn there is what is chosen there"


def test_the_points_are_where_depth_showed_them_and_can_be_switched_off(
    home: Path, beside: Callable[..., Beside], visit: Callable[..., Any]
) -> None:
    tab = visit(beside("serve", home).url)
    assert tab.locator("#points").is_hidden() and not any("cloud" in url for url in tab.asked), (
        "not before they are seen"
    )
    tab.click("#solid")
    tab.wait_for_function("() => scene.cloud && scene.canvas.width > 10")
    seen = Home.load(home).cloud()
    assert seen is not None and tab.evaluate("scene.cloud.count") == int(
        (seen.xyz_m[:, 2] <= tab.evaluate("CUT_M") + 1e-9).sum()
    ), "nothing here is taller than the cut"
    floor = seen.xyz_m[:, 2] < 0.01
    middle = seen.xyz_m[floor][np.abs(seen.xyz_m[floor][:, :2] - (2.5, 1.5)).sum(1).argmin()]
    pixel = """p => { scene.fit(); scene.rotate(0, 1);
      const [x, y] = scene.project(p), box = scene.canvas.getBoundingClientRect(),
      k = scene.canvas.width / box.width, pixel = new Uint8Array(4);
      scene.gl.readPixels(Math.round((x - box.left) * k), scene.canvas.height - 1 - Math.round((y - box.top) * k),
        1, 1, scene.gl.RGBA, scene.gl.UNSIGNED_BYTE, pixel);
      return [...pixel]; }"""
    colour = seen.rgb[floor][0]
    assert np.abs(np.array(tab.evaluate(pixel, middle.tolist())[:3]) - colour).max() < 12
    tab.uncheck("#points")
    assert np.abs(np.array(tab.evaluate(pixel, middle.tolist())[:3]) - colour).max() > 30
    tab.click("#flat")
    assert tab.locator("#points").is_hidden()
    assert sum("cloud" in url for url in tab.asked) == 1


def test_a_click_in_3d_chooses_the_smallest_that_holds_the_surface_and_no_ghost(
    home: Path, tmp_path: Path, visit: Callable[..., Any]
) -> None:
    from flat import obj

    mapped = Home.load(home)
    table = next(t for t in mapped.objects if t.label == "table")
    x, y, top = table.box_max[0] - 0.2, table.position[1], table.box_max[2]  # the mug stands in the middle
    plate = obj(70, "plate", (x, y, top), (0.2, 0.2, 0.06))
    ghost = obj(71, "ghost", (x, y, top), (3, 3, 1), probability=0.2)
    file = tmp_path / "home.html"
    file.write_bytes(one_file(replace(mapped, objects=(*mapped.objects, plate, ghost))))
    tab = visit(file.as_uri())
    tab.click("#solid")
    tab.wait_for_function("() => scene.cloud && scene.canvas.width > 10")
    tab.evaluate("scene.rotate(0, 1)")  # from above
    corner = [table.box_min[0] + 0.08, table.box_min[1] + 0.08, top]
    for shown, point, expected in (
        (True, [x, y, top], "plate"), (True, corner, "table"),
        (False, corner, "table"), (False, [x, y, top + 0.03], "plate"),
    ):  # fmt: skip
        tab.set_checked("#points", shown)
        tab.evaluate("choose(null)")
        tab.mouse.click(*tab.evaluate("p => scene.project(p)", point))
        assert card(tab).startswith(expected), (shown, point)
    names = tab.evaluate("[...document.querySelectorAll('#names text')].map((t) => t.textContent)")
    assert "table" in names and not any("ghost" in name for name in names)


def test_a_home_of_an_older_cartier_has_no_points_and_opens_as_before(
    home: Path, tmp_path: Path, visit: Callable[..., Any]
) -> None:
    older = Home.load(home)
    replace(older, growth={k: v for k, v in older.growth.items() if k != "cloud.npz"}).save(tmp_path / "older")
    file = tmp_path / "home.html"
    file.write_bytes(one_file(Home.load(tmp_path / "older")))
    tab = visit(file.as_uri())
    tab.click("#solid")
    tab.wait_for_function("() => scene.gl && scene.canvas.width > 10")
    assert tab.locator("#points").is_hidden() and tab.evaluate("scene.cloud") is None


HOST = """async ([html, result]) => {
  const frame = document.createElement("iframe"), seen = [];
  frame.sandbox = "allow-scripts"; frame.srcdoc = html; frame.style = "width: 100%; height: 420px; border: 0";
  window.addEventListener("message", (e) => {
    if (!frame.contentWindow || e.source !== frame.contentWindow) return;
    const said = e.data, send = (message) => frame.contentWindow.postMessage({ jsonrpc: "2.0", ...message }, "*");
    seen.push(said);
    if (said.method === "ui/initialize") send({ id: said.id, result: {
      protocolVersion: "2026-01-26", hostInfo: { name: "test", version: "1" },
      hostCapabilities: {}, hostContext: { theme: "dark", containerDimensions: { maxHeight: 600 } } } });
    if (said.method === "ui/notifications/initialized") {
      send({ method: "ui/notifications/tool-input", params: { arguments: {} } });
      send({ method: "ui/notifications/tool-result", params: result }); }
    if (said.method === "ui/message") send({ id: said.id, result: {} });
  });
  window.seen = seen;
  document.body.replaceChildren(frame);
}"""


def test_a_host_for_mcp_apps_shows_the_answer(home: Path, visit: Callable[..., Any], tmp_path: Path) -> None:
    """A host as the specification says: a sandbox of another origin, and JSON-RPC with it by messages."""
    pytest.importorskip("mcp", reason="needs cartier[mcp]")
    from cartier.serving.homes import Homes
    from cartier.serving.operations import Operations
    from serving.test_operations import Echo

    ops = Operations(Homes([home]), Echo())
    told = ops.ask("chair")
    clarify = {key: told[key] for key in ("home", "home_id", "age_h")} | {"status": "clarify", "question": "Which one?"}
    clarify |= {"candidates": [["mug", 0.5], ["table", 0.4]], "goal": None}
    blank = tmp_path / "blank.html"
    blank.write_text("<!doctype html><html data-ready><body>")
    tab = visit(blank.as_uri())

    def shown(result: dict[str, Any]) -> Any:
        tab.evaluate(HOST, [page.answer_page(), {"content": [], "_meta": {"cartier/answer": page.answer(ops, result)}}])
        frame = tab.frame_locator("iframe")
        frame.locator("#plan .object").first.wait_for()
        return frame

    frame = shown(told)
    frame.locator("#photo i").wait_for()
    assert frame.locator("#plan .way").count() == 1 and frame.locator("#plan .object.chosen").count() == 1
    assert frame.locator("#what").inner_text() == "chair" and "m to drive" in frame.locator("#way").inner_text()
    assert "dark" in (frame.locator("html").get_attribute("class") or "") and frame.locator("#this").is_hidden()
    assert any(
        m["method"] == "ui/notifications/size-changed" and m["params"]["height"] > 100 for m in tab.evaluate("seen")
    )
    frame = shown(clarify)
    assert frame.locator("#what").inner_text() == "Which one?" and frame.locator("#plan .object:not(.dim)").count() == 2
    mug = next(t for t in Home.load(home).objects if t.label == "mug")
    frame.locator(f'#plan .object[data-id="{mug.id}"]').click()
    frame.locator("#this").click()
    tab.wait_for_function("() => seen.some((m) => m.method === 'ui/message')")
    said = next(m for m in tab.evaluate("seen") if m["method"] == "ui/message")["params"]
    assert said == {"role": "user", "content": [{"type": "text", "text": f"The mug {mug.id}."}]}
    assert [url for url in tab.asked if not url.startswith(("data:", "about:"))] == [blank.as_uri()], "no network"


def test_rules_are_listed_with_their_sentences_and_taken_back(
    home: Path, beside: Callable[..., Beside], visit: Callable[..., Any]
) -> None:
    chair = next(t for t in Home.load(home).objects if t.label == "chair")
    Home.load(home).correct("rule", f"keep-away object:{chair.id} hard standing")
    tab = visit(beside("serve", home).url)
    tab.fill("#words", "never drive over the rug")
    tab.click("#ask button.main")
    tab.wait_for_selector("#turns .robot:nth-of-type(3)")
    tab.click("#tab-rules")
    tab.locator("#rule-list button").nth(1).wait_for(state="attached")
    kept = Home.load(home).rules
    rows = tab.locator("#rule-list li")
    assert rows.count() == len(kept) and tab.inner_text("#rule-count") == str(len(kept))
    assert f"Keep away from the object {chair.id}" in rows.first.inner_text() or "Keep away" in rows.first.inner_text()
    rows.first.locator("text=Take back").click()
    tab.locator("#rule-list button").nth(len(kept) - 1).wait_for(state="detached")
    assert [rule.id for rule in Home.load(home).rules] == [rule.id for rule in kept[1:]]
    assert tab.locator("#rule-list li button").count() == len(kept) - 1


def test_the_way_without_rules_is_drawn_beside_the_way_under_them(
    home: Path, beside: Callable[..., Beside], visit: Callable[..., Any]
) -> None:
    chair = next(t for t in Home.load(home).objects if t.label == "chair")
    tab = visit(beside("serve", home).url)
    tab.evaluate(f"choose({chair.id})")
    tab.wait_for_selector("#plan .way")
    assert tab.locator("#plan .shortest").count() == 0
    Home.load(home).correct("rule", f"slow-near object:{chair.id} soft standing")
    tab.reload()
    tab.wait_for_selector("html[data-ready]")
    tab.evaluate(f"choose({chair.id})")
    tab.wait_for_selector("#plan .shortest", state="attached")
    assert tab.locator("#plan .way:not(.shortest)").count() == 1


def test_a_colour_may_have_any_name(home: Path, tmp_path: Path, visit: Callable[..., Any]) -> None:
    """A look-up of ``constructor`` on a bare object gives a function, and the 3-D view threw."""
    odd = ("constructor", "__proto__", "toString", "hasOwnProperty")
    mapped = Home.load(home)
    objects = [replace(obj, colours=((odd[k % 4], 1.0),)) for k, obj in enumerate(mapped.objects)]
    file = tmp_path / "home.html"
    file.write_bytes(one_file(replace(mapped, objects=tuple(objects))))
    tab = visit(file.as_uri())
    assert set(tab.evaluate("data.objects.map(colourOf)")) == {"#4a78b8"}
    tab.click("#solid")
    tab.wait_for_function("() => scene.gl && scene.canvas.width > 10")
