"""What is suggested in place of a name that does not exist."""

from __future__ import annotations

import pytest

from engine.errors import nearest

SIGNALS = ["link.hub.angle", "motor.shaft.angle", "motor.shaft.speed", "motor.current", "link.tip.deflection"]
PARAMETERS = ["resistance", "torque_constant", "efficiency", "rotor_inertia", "viscous_friction"]


@pytest.mark.parametrize(
    ("name", "among", "said"),
    [
        ("Encodr", ["Encoder", "Gear"], "did you mean 'Encoder'?"),
        ("gear", ["Encoder", "Gear"], "did you mean 'Gear'?"),
        ("speed", SIGNALS, "did you mean 'motor.shaft.speed'?"),
        ("angle", SIGNALS, "did you mean 'link.hub.angle' or 'motor.shaft.angle'?"),
        ("tip", SIGNALS, "did you mean 'link.tip.deflection'?"),
        ("inertia", PARAMETERS, "did you mean 'rotor_inertia'?"),
        # Letters that happen to agree are no suggestion.
        ("mass", PARAMETERS, f"allowed: {', '.join(PARAMETERS)}"),
        ("Angle", ["Table", "Rotor"], "allowed: Table, Rotor"),
        ("Rotation", ["Vibration"], "allowed: Vibration"),
        ("any", [], "none is allowed here"),
    ],
)
def test_what_is_suggested(name: str, among: list[str], said: str) -> None:
    assert nearest(name, among) == said


def test_a_list_is_whole_or_says_how_much_is_left_out() -> None:
    names = [f"signal{k:03d}" for k in range(60)]
    assert nearest("?", names) == f"allowed: {', '.join(names)}"
    long = nearest("?", [f"signal{k:03d}" for k in range(500)])
    shown = long.removeprefix("allowed: ").split(", ")
    assert long.endswith(f", and {500 - (len(shown) - 1)} more")
    assert len(long) < 800
