"""Reports as a reader meets them: opened from the disk in a headless Chromium, clicked through, used by keyboard."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

import flexarm
from diagnosis.api import diagnose, fit, gather
from diagnosis.binding import find_recording
from diagnosis.compare import compare
from diagnosis.verdict.experiment_design import propose
from flexarm.plotting.wiring.diagram import diagram
from flexarm.report import write_comparisons, write_diagnosis, write_fit, write_run
from scenarios.load import load, shipped_names
from tests.diagnosis.plants import case
from tests.report.conftest import HOSTILE, axes
from tests.report.test_pages import check_outline

WIDTHS = (400, 1600)


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Any]:
    """The report of a concealed friction, with a rival, a proposal and a curve, from files full of markup."""
    folder = tmp_path_factory.mktemp("diagnosed")
    path = case(folder, coulomb=4.0e-4, seed=3)
    text = path.read_text().replace("name: bench-motor", f"name: {HOSTILE!r}".replace("\\'", "''"))
    path.write_text(text.replace("# measured cold", f"# measured cold {HOSTILE}"))
    found = diagnose(path)
    other = next(t for t in found.study.trials if t.effects != found.study.chosen.effects)
    found = replace(
        found, rivals=(other,), proposal=propose([found.study.chosen, other], found.study.refit.fit.problem.model)
    )
    assert found.evidence
    page = write_diagnosis(found, folder / "report.html", seed=3, command=f"flexarm diagnose {HOSTILE}")
    return found, page


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("simulated")
    scenario = load(axes(folder, 2))
    return write_run(scenario, flexarm.simulate(scenario), folder / "run.html")


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("fitted")
    made, scores = fit(case(folder, coulomb=4.0e-4, seed=3), workers=1)
    return write_fit(made, scores, folder / "fit.html", seed=0, command=f"flexarm fit {HOSTILE}")


@pytest.fixture(scope="module")
def compared(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("compared")
    scenario = load(case(folder, coulomb=4.0e-4, seed=3))
    found = [(find_recording(scenario, name), compare(scenario, name)) for name in scenario.recordings]
    return write_comparisons(scenario, found, folder / "comparison.html", command=f"flexarm compare {HOSTILE}")


@pytest.fixture
def page(request: pytest.FixtureRequest) -> Any:
    """The page of that kind."""
    found = request.getfixturevalue(request.param)
    return found[1] if request.param == "diagnosed" else found


both = pytest.mark.parametrize("page", ["diagnosed", "simulated", "fitted", "compared"], indirect=True)


def test_the_report_holds_the_verdict_and_what_repeats_it(diagnosed: tuple[Any, Any]) -> None:
    found, page = diagnosed
    text = page.read_text()
    check_outline(text)
    assert page.stat().st_size < 3e6
    assert HOSTILE not in text
    assert found.findings[0]["place"] in text
    assert found.evidence
    assert all(curve.title in text for curve in found.evidence)
    for recording in gather(found.study.scenario, (), ()):
        assert f"{recording.name}.csv" in text
    assert "flexarm diagnose &lt;script&gt;" in text
    assert "Coulomb friction" in text


def test_a_report_of_none_draws_no_odds(diagnosed: tuple[Any, Any]) -> None:
    """Odds are of an effect that is there: beside a verdict that names none, a bar of 99 % says the opposite."""
    found, page = diagnosed
    assert "Odds of each place" in page.read_text()
    plain = replace(found, verdict="none", findings=({**found.findings[0], "status": "none"},))
    text = write_diagnosis(plain, page.parent / "none.html").read_text()
    assert "Odds of each place" not in text
    assert 'class="share"' not in text


@both
@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("dark", [False, True])
def test_a_page_opens_silently_asks_nothing_and_fits(
    browser: Any, page: Any, width: Any, dark: bool, tmp_path: Path
) -> None:
    browser.open(page, width, dark=dark)
    assert browser.run("return document.title") not in ("", "broken")
    size = browser.run("const e = document.documentElement; return [e.scrollWidth, e.clientWidth]")
    assert size[0] <= size[1]
    assert browser.complaints() == []
    asked = [a for a in browser.requests() if not a.startswith("data:")]
    assert asked == [page.resolve().as_uri()]
    curves = browser.run("return [...document.querySelectorAll('.plot .trace')].map(p => p.getAttribute('d').length)")
    assert curves
    assert max(curves) > 100
    browser.shot(tmp_path / "page.png")
    assert (tmp_path / "page.png").stat().st_size > 20_000


@both
def test_no_text_lies_on_another(browser: Any, page: Any) -> None:
    browser.open(page)
    clashes = browser.run(
        """
        const found = [];
        for (const svg of document.querySelectorAll(".picture svg, .plot .area > svg")) {
          const rows = [...svg.querySelectorAll("text")].map(t => [t.textContent, t.getBoundingClientRect()]);
          rows.forEach(([a, p], i) => rows.slice(0, i).forEach(([b, q]) => {
            const w = Math.min(p.right, q.right) - Math.max(p.left, q.left);
            const h = Math.min(p.bottom, q.bottom) - Math.max(p.top, q.top);
            if (w > 1 && h > 3) found.push(a + " on " + b);
          }));
        }
        return found;
        """
    )
    assert clashes == []


@pytest.mark.parametrize("font", ["DejaVu Sans", "Liberation Sans", "serif"])
def test_labels_of_diagrams_keep_to_their_boxes_in_any_font(browser: Any, font: str, tmp_path: Path) -> None:
    """DejaVu is wider than nearly all fonts that stand in for Helvetica."""
    for scenario in (*map(load, shipped_names()), load(axes(tmp_path, 2))):
        svg = diagram(scenario, dict.fromkeys(scenario.system.blocks, 0.7)).svg()
        page = tmp_path / "a.html"
        page.write_text(f"<!DOCTYPE html><style>text {{ font-family: '{font}' !important }}</style>{svg}")
        browser.open(page)
        script = """
            const found = [], texts = [...document.querySelectorAll("text")];
            const rows = texts.map(t => [t.textContent, t.getBoundingClientRect()]);
            rows.forEach(([a, p], i) => rows.slice(0, i).forEach(([b, q]) => {
              const w = Math.min(p.right, q.right) - Math.max(p.left, q.left);
              const h = Math.min(p.bottom, q.bottom) - Math.max(p.top, q.top);
              if (w > 1 && h > 3) found.push(a + " on " + b);
            }));
            for (const group of document.querySelectorAll("g[data-about]")) {
              const box = group.querySelector(".fx-box")?.getBoundingClientRect();
              for (const text of box ? group.querySelectorAll("text") : []) {
                const t = text.getBoundingClientRect();
                if (t.left < box.left || t.right > box.right || t.bottom > box.bottom + 1) found.push(text.textContent);
              }
            }
            return found;
            """
        assert browser.run(script) == [], scenario.name


@both
def test_texts_stand_out_from_their_ground(browser: Any, page: Any) -> None:
    script = """
        const light = c => { const v = c.match(/[\\d.]+/g).slice(0, 3).map(x => x / 255)
          .map(x => x <= 0.03928 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4);
          return 0.2126 * v[0] + 0.7152 * v[1] + 0.0722 * v[2]; };
        const ground = n => { for (; n; n = n.parentElement) { const c = getComputedStyle(n).backgroundColor;
          if (!/, 0\\)$|transparent/.test(c)) return c; } return "rgb(255, 255, 255)"; };
        const bad = [];
        const kinds = "p, td, th, dt, dd, li, h1, h2, h3, summary, pre span, button, .picture text, .plot text";
        for (const n of document.querySelectorAll(kinds)) {
          if (!n.textContent.trim() || n.getAttribute("aria-pressed") === "false") continue;
          const style = getComputedStyle(n), ink = n.namespaceURI.endsWith("svg") ? style.fill : style.color;
          const [a, b] = [light(ink), light(ground(n))];
          const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
          if (ratio < 4.5) bad.push(ratio.toFixed(2) + " " + n.textContent.slice(0, 30));
        }
        return bad;
        """
    for dark in (False, True):
        browser.open(page, dark=dark)
        assert browser.run(script) == []


def _range(browser: Any, plot: Any) -> tuple[float, float]:
    texts = browser.run(
        "const f = document.querySelector(`[data-plot='${arguments[0]}']`);"
        "const ticks = f.querySelectorAll('.area > svg > text.tick[text-anchor=middle]');"
        "return [...ticks].map(t => t.textContent.replace('−', '-'))",
        plot,
    )
    return float(texts[0]), float(texts[-1])


def test_plots_zoom_by_button_key_and_mouse(browser: Any, diagnosed: tuple[Any, Any]) -> None:
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys

    browser.open(diagnosed[1])
    figure = browser.driver.find_element(By.CSS_SELECTOR, "[data-plot='before-after']")
    whole = _range(browser, "before-after")
    button = {b.get_attribute("aria-label"): b for b in figure.find_elements(By.TAG_NAME, "button")}
    button["Zoom in"].click()
    half = _range(browser, "before-after")
    assert half[1] - half[0] < 0.7 * (whole[1] - whole[0])
    button["Later"].click()
    later = _range(browser, "before-after")
    assert later[0] > half[0]
    button["Show all"].click()
    assert _range(browser, "before-after") == whole
    area = figure.find_element(By.CSS_SELECTOR, ".area")
    browser.run("arguments[0].focus()", area)
    area.send_keys("+")
    assert _range(browser, "before-after") == half
    area.send_keys(Keys.ARROW_RIGHT)
    assert _range(browser, "before-after") == later
    area.send_keys("0")
    assert _range(browser, "before-after") == whole
    reading = figure.find_element(By.CSS_SELECTOR, ".reading").text
    assert "time from 0 s" in reading
    ActionChains(browser.driver).move_to_element_with_offset(area, -200, 0).click_and_hold().move_by_offset(
        200, 0
    ).release().perform()
    dragged = _range(browser, "before-after")
    assert dragged[1] - dragged[0] < 0.5 * (whole[1] - whole[0])
    ActionChains(browser.driver).double_click(area).perform()
    assert _range(browser, "before-after") == whole
    assert browser.complaints() == []


def test_recordings_are_chosen_and_curves_hidden(browser: Any, diagnosed: tuple[Any, Any]) -> None:
    from selenium.webdriver.common.by import By
    from selenium.webdriver.support.ui import Select

    found, page = diagnosed
    browser.open(page)
    figure = browser.driver.find_element(By.CSS_SELECTOR, "[data-plot='before-after']")
    select = Select(figure.find_element(By.TAG_NAME, "select"))
    held = [e.name for e in found.study.refit.fit.problem.held_out]
    # Those that were fitted stand behind them.
    assert [o.text.split(" ")[0] for o in select.options[: len(held)]] == held
    assert len(select.options) == len(found.study.recordings)
    path = "return document.querySelector(\"[data-plot='before-after'] .trace.recording[d^=M]\").getAttribute('d')"
    script = path.replace("document.querySelector", "[...document.querySelectorAll").replace(
        ").getAttribute", ")].at(-1).getAttribute"
    )
    one = browser.run(script)
    select.select_by_index(1)
    assert browser.run(script) != one
    count = "return document.querySelectorAll(\"[data-plot='before-after'] .area .trace.recording\").length"
    assert browser.run(count) > 0
    figure.find_element(By.XPATH, ".//button[normalize-space()='recording']").click()
    assert browser.run(count) == 0


@both
def test_everything_is_reached_by_tab_in_order_and_seen(browser: Any, page: Any) -> None:
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.keys import Keys

    browser.open(page)
    wanted = browser.run(
        "return [...document.querySelectorAll('a[href], button, select, summary, [tabindex=\"0\"]')]"
        ".filter(n => n.checkVisibility()).length"
    )
    seen, tops = 0, []
    for _ in range(wanted + 5):
        ActionChains(browser.driver).send_keys(Keys.TAB).perform()
        state = browser.run(
            """const n = document.activeElement; if (n === document.body) return null;
            const s = getComputedStyle(n); const first = !n.dataset.visited; n.dataset.visited = "1";
            return [first, s.outlineStyle, parseFloat(s.outlineWidth), n.getBoundingClientRect().top + scrollY]"""
        )
        if state is None or not state[0]:
            break
        seen += 1
        assert state[1] != "none", "the focus cannot be seen"
        assert state[2] >= 2
        tops.append(state[3])
    assert seen == wanted
    assert all(b > a - 60 for a, b in pairwise(tops[1:])), "the order of focus jumps upwards"


def test_details_open_by_keyboard(browser: Any, diagnosed: tuple[Any, Any]) -> None:
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys

    browser.open(diagnosed[1])
    summary = browser.driver.find_element(By.TAG_NAME, "summary")
    summary.send_keys(Keys.ENTER)
    assert browser.run("return document.querySelector('details').open")


def test_a_warning_shows_the_recording_that_it_is_about(
    browser: Any, diagnosed: tuple[Any, Any], tmp_path: Path
) -> None:
    """A link beside a warning chooses the recording in the plot that it leads to."""
    found, _ = diagnosed
    name = found.study.recordings[-1].name
    found = replace(found, warnings=(f"'motor.shaft.speed' of recording '{name}' jumps",))
    browser.open(write_diagnosis(found, tmp_path / "warned.html"), WIDTHS[1])
    assert not browser.complaints()
    link = "document.querySelector('a[data-show]')"
    view = browser.run(f"return {link}.dataset.view")
    assert view.startswith(name)
    browser.run(f"{link}.click()")
    select = "document.querySelector('figure[data-plot=\"before-after\"] select')"
    assert browser.run(f"return {select}.selectedOptions[0].textContent") == view
