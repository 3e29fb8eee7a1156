"""Scenarios to draw, and a headless Chromium that must neither complain nor ask the network for anything."""

from __future__ import annotations

import base64
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

HOSTILE = "<script>document.title='broken'</script>&\"'"

AXIS = """\
schema: 1
name: axis
blocks:
  amp: {type: Gain, gain: 2}
  motor: {type: DCMotor, resistance: 2.6 ohm, torque_constant: 7.68 mN.m/A, rotor_inertia: 4.606e-7 kg.m2}
  friction: {type: BearingFriction, coulomb_friction: 2e-4 N.m}
  gear: {type: Gear, ratio: 14}
  play: {type: Backlash, stiffness: 2.352 N.m/rad, damping: 5.88e-3 N.m.s/rad, half_gap: 0.01 rad}
  encoder: {type: Encoder, counts_per_revolution: 4096}
connect:
  - [amp.out, motor.voltage]
  - [motor.shaft, friction.shaft, gear.input]
  - [motor.shaft, encoder.shaft]
  - [gear.output, play.a]
expose: {command: amp.in, shaft: play.b, reading: encoder.out}
"""


def axes(folder: Path, count: int) -> Path:
    """A scenario of several axes, each a sub-assembly in a position loop of its own."""
    (folder / "axis.yaml").write_text(AXIS)
    blocks, wires = [], []
    for i in range(count):
        blocks += [
            f"  source{i}: {{type: Step, height: 1 rad, stop: 1 s}}",
            f"  pi{i}: {{type: PI, proportional_gain: 0.5, integral_gain: 0.5}}",
            f"  axis{i}: {{type: ./axis.yaml}}",
            f"  load{i}: {{type: Inertia, inertia: 0.01 kg.m2}}",
        ]
        wires += [
            f"  - [source{i}.out, pi{i}.reference]",
            f"  - [axis{i}.reading, pi{i}.measurement]",
            f"  - [pi{i}.out, axis{i}.command]",
            f"  - [axis{i}.shaft, load{i}.shaft]",
        ]
    path = folder / "axes.yaml"
    head = f"schema: 1\nname: {json.dumps(HOSTILE)}\nblocks:\n"
    record = "simulate: {stop: 0.2 s, record: [load0.shaft.angle, axis0.motor.shaft.speed]}\n"
    path.write_text(head + "\n".join(blocks) + "\nconnect:\n" + "\n".join(wires) + "\n" + record)
    return path


def chain(folder: Path, count: int) -> Path:
    """A motor that drives a chain of springs, inertias and bearings: three blocks a member."""
    blocks = [
        "  command: {type: Sine, amplitude: 1 rad/s, frequency: 1 Hz}",
        "  pi: {type: PI, proportional_gain: 0.5 V.s/rad, integral_gain: 0.5 V/rad}",
        "  motor: {type: DCMotor, resistance: 2.6 ohm, torque_constant: 7.68 mN.m/A, rotor_inertia: 4.606e-7 kg.m2}",
    ]
    wires = [
        "  - [command.out, pi.reference]",
        "  - [motor.shaft.speed, pi.measurement]",
        "  - [pi.out, motor.voltage]",
    ]
    end = "motor.shaft"
    for i in range(count):
        blocks += [
            f"  spring{i}: {{type: SpringDamper, stiffness: 1 N.m/rad, damping: 1e-3 N.m.s/rad}}",
            f"  body{i}: {{type: Inertia, inertia: 0.01 kg.m2}}",
            f"  bearing{i}: {{type: BearingFriction, coulomb_friction: 2e-4 N.m}}",
        ]
        wires += [f"  - [{end}, spring{i}.a]", f"  - [spring{i}.b, body{i}.shaft, bearing{i}.shaft]"]
        end = f"body{i}.shaft"
    path = folder / "chain.yaml"
    text = "schema: 1\nname: chain\nblocks:\n" + "\n".join(blocks) + "\nconnect:\n" + "\n".join(wires)
    path.write_text(text + "\nsimulate: {stop: 1 s}\n")
    return path


class Browser:
    """Chromium with its console and its network traffic kept."""

    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def open(self, path: Path, width: int = 1600, *, dark: bool = False) -> None:
        """Open a file as a page of some width."""
        size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        theme = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": theme})
        self.driver.get_log("browser"), self.driver.get_log("performance")
        self.driver.get(path.resolve().as_uri())

    def run(self, script: str, *values: Any) -> Any:
        """What a script returns."""
        return self.driver.execute_script(script, *values)

    def complaints(self) -> list[str]:
        """What the console holds."""
        return [row["message"] for row in self.driver.get_log("browser")]

    def requests(self) -> list[str]:
        """Addresses asked for since the page was opened."""
        rows = [json.loads(row["message"])["message"] for row in self.driver.get_log("performance")]
        return [r["params"]["request"]["url"] for r in rows if r["method"] == "Network.requestWillBeSent"]

    def shot(self, path: Path) -> None:
        """A picture of the whole page."""
        box = self.run("const e = document.documentElement; return [e.clientWidth, e.scrollHeight]")
        clip = {"x": 0, "y": 0, "width": box[0], "height": box[1], "scale": 1}
        options = {"captureBeyondViewport": True, "format": "png", "clip": clip}
        path.write_bytes(base64.b64decode(self.driver.execute_cdp_cmd("Page.captureScreenshot", options)["data"]))


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """A headless Chromium; the test is skipped where there is none."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    driver = shutil.which("chromedriver")
    if chromium is None or driver is None:
        pytest.skip("no Chromium with its driver (Debian: apt-get install chromium chromium-driver)")
    webdriver = pytest.importorskip("selenium.webdriver")
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for flag in (
        "--headless=new",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-dev-shm-usage",
        "--hide-scrollbars",
        "--window-size=1600,900",
    ):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    made = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    yield Browser(made)
    made.quit()
