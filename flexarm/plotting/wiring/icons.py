"""Small signs in the boxes of a block diagram, 22 by 22, by type of block or else by its folder of the library."""

from __future__ import annotations

import math

from flexarm.plotting.wiring.shapes import Box, Disc, Label, Poly, Shape

SIZE = 22.0

LETTERS = {
    "PI": "PI",
    "PID": "PID",
    "TransferFunction": "H(s)",
    "DiscreteTransferFunction": "H(z)",
    "StateSpace": "A B",
    "DiscreteStateSpace": "A B z",
    "StateFeedback": "-K",
    "Observer": "x^",
    "RigidFeedForward": "FF1",
    "TwoMassFeedForward": "FF2",
    "ThreeMassFeedForward": "FF3",
    "FieldOrientedController": "dq",
    "DutyServo": "d V",
    "Bridge": "PWM",
    "PythonController": "f(t)",
    "FMU": "FMU",
}
"""Blocks that are known by letters rather than by a curve."""

Curve = tuple[tuple[float, float], ...]

CURVES: dict[str, tuple[Curve, ...]] = {
    "Gain": (((4, 3), (4, 19), (19, 11), (4, 3)),),
    "Offset": (((2, 15), (20, 15)), ((11, 15), (11, 4)), ((8, 7), (11, 4), (14, 7))),
    "UnevenGain": (((2, 14), (11, 11), (20, 2)), ((2, 11), (20, 11))),
    "LowPass": (((2, 6), (10, 6), (20, 18)),),
    "Notch": (((2, 5), (8, 6), (11, 19), (14, 6), (20, 5)),),
    "Delay": (((2, 17), (6, 17), (6, 5), (10, 5)), ((11, 17), (15, 17), (15, 5), (20, 5))),
    "SampleHold": (((2, 18), (7, 18), (7, 12), (12, 12), (12, 8), (17, 8), (17, 4), (21, 4)),),
    "JitteredSample": (((2, 18), (8, 18), (8, 13), (11, 13), (11, 8), (18, 8), (18, 4), (21, 4)), ((8, 20), (8, 22))),
    "InputShaper": (((2, 18), (20, 18)), ((5, 18), (5, 4)), ((12, 18), (12, 9)), ((18, 18), (18, 13))),
    "Chirp": (((1, 11), (4, 4), (8, 18), (11, 4), (13, 18), (15, 4), (16.5, 18), (18, 4), (19, 18), (20, 11)),),
    "Multisine": (((1, 11), (3, 5), (5, 9), (7, 4), (10, 16), (12, 12), (14, 18), (17, 7), (19, 13), (21, 11)),),
    "PRBS": (((1, 17), (4, 17), (4, 5), (10, 5), (10, 17), (12, 17), (12, 5), (15, 5), (15, 17), (21, 17)),),
    "Trajectory": (((1, 18), (3, 18), (8, 5), (14, 5), (19, 18), (21, 18)),),
    "Table": (
        ((3, 4), (19, 4), (19, 18), (3, 18), (3, 4)),
        ((3, 9), (19, 9)),
        ((3, 13.5), (19, 13.5)),
        ((9, 4), (9, 18)),
    ),
    "Spline": (((2, 16), (6, 9), (10, 8), (14, 13), (18, 7), (21, 3)),),
    "Constant": (((2, 8), (20, 8)), ((2, 18), (20, 18))),
    "Pulse": (((1, 17), (5, 17), (5, 5), (9, 5), (9, 17), (14, 17), (14, 5), (18, 5), (18, 17), (21, 17)),),
    "Relay": (((2, 17), (13, 17), (13, 5), (20, 5)), ((9, 5), (9, 17)), ((9, 5), (13, 5))),
    "LookupTable2D": (
        ((2, 8), (9, 3), (20, 6), (13, 12), (2, 8)),
        ((2, 8), (2, 16)),
        ((13, 12), (13, 20)),
        ((2, 16), (13, 20)),
    ),
    "GainSchedule": (
        ((2, 18), (8, 18), (8, 13), (14, 6), (20, 4)),
        ((14, 20), (14, 14)),
        ((12, 17), (14, 14), (16, 17)),
    ),
    "GravityTorque": (((11, 2), (11, 19)), ((6, 14), (11, 19), (16, 14))),
    "Fixed": (((11, 2), (11, 11)), ((3, 11), (19, 11)), ((4, 17), (8, 11)), ((10, 17), (14, 11)), ((15, 17), (19, 11))),
    "Encoder": (
        ((2, 18), (2, 6), (5, 6), (5, 18), (8, 18), (8, 6), (11, 6), (11, 18), (14, 18), (14, 6), (17, 6), (17, 18)),
    ),
    "DeadTime": (((2, 19), (9, 15), (9, 13), (13, 9), (13, 7), (20, 3)), ((2, 11), (20, 11)), ((11, 3), (11, 19))),
    "CurrentLimiter": (((2, 18), (7, 18), (15, 4), (20, 4)), ((2, 11), (20, 11)), ((11, 8), (11, 14))),
    "TorqueEnvelope": (((2, 5), (9, 5), (13, 10), (18, 13), (18, 19)), ((2, 19), (20, 19)), ((2, 3), (2, 19))),
    "Supply": (((2, 11), (8, 11)), ((8, 3), (8, 19)), ((13, 7), (13, 15)), ((13, 11), (20, 11))),
    "BrakeChopper": (((2, 11), (6, 11), (11, 5)), ((12, 11), (13, 7), (15, 15), (17, 7), (19, 15), (20, 11))),
    "Curve": (((2, 18), (7, 14), (11, 12), (15, 6), (20, 4)), ((2, 11), (20, 11)), ((11, 2), (11, 20))),
    "QuadraticDrag": (((2, 19), (7, 13), (11, 11), (15, 9), (20, 3)), ((2, 11), (20, 11))),
}
"""Signs that are drawn of lines alone, by type; points from the upper left corner."""

LIKE = {
    "TranslationalFixed": "Fixed",
    "LinearEncoder": "Encoder",
    "TorqueCurve": "Curve",
    "ForceCurve": "Curve",
    "TranslationalQuadraticDrag": "QuadraticDrag",
}
"""Types with the sign of another."""


def icon(kind: str, folder: str, x: float, y: float) -> list[Shape]:
    """The sign of a block of type ``kind`` with its upper left corner at a point."""

    def line(*points: tuple[float, float]) -> Poly:
        return Poly("icon", tuple((x + a, y + b) for a, b in points))

    def ring(a: float, b: float, radius: float) -> Disc:
        return Disc("icon", x + a, y + b, radius)

    def spring(height: float) -> Poly:
        zigzag = [(5.0 + 2 * k, height + (3.5 if k % 2 else -3.5)) for k in range(1, 6)]
        return line((0, height), (5, height), *zigzag, (17, height), (22, height))

    if kind in LETTERS:
        letters = LETTERS[kind]
        return [Label("icon-text", x + 11, y + 15, letters, 11 if len(letters) < 3 else 8, "middle")]
    if (drawn := CURVES.get(LIKE.get(kind, kind))) is not None:
        return [line(*points) for points in drawn]
    word = kind.lower()
    if kind in ("DCMotor", "ThermalDCMotor", "PMSM"):
        letters = "3~" if kind == "PMSM" else "M"
        return [ring(11, 11, 9), Label("icon-text", x + 11, y + 15, letters, 11, "middle")]
    if kind == "Belt":
        return [ring(5, 11, 4), ring(17, 11, 4), line((5, 7), (17, 7)), line((5, 15), (17, 15))]
    if kind == "Pulley":
        return [ring(7, 11, 5), line((7, 6), (22, 6)), line((7, 16), (22, 16))]
    if kind == "RackAndPinion":
        teeth = [(1.0 + 2.5 * k, 20.0 if k % 2 else 16.0) for k in range(9)]
        return [ring(11, 8, 6), line(*teeth)]
    if kind == "Screw":
        thread = [line((3 + 4 * k, 16), (6 + 4 * k, 6)) for k in range(4)]
        return [line((0, 8), (22, 8)), line((0, 14), (22, 14)), *thread]
    if "endstop" in word:
        return [
            line((3, 4), (3, 18)),
            line((19, 4), (19, 18)),
            Box("icon", x + 8, y + 7, 6, 8, 1),
            line((3, 11), (19, 11)),
        ]
    if "gear" in word or "harmonic" in word:
        return [ring(7, 12, 6), ring(16.5, 10, 4)]
    if "backlash" in word:
        return [line((0, 11), (8, 11)), line((8, 5), (8, 17)), line((14, 5), (14, 17)), line((14, 11), (22, 11))]
    if "friction" in word or "brake" in word:
        return [line((2, 8), (20, 8)), line((2, 11), (20, 11)), *(line((k, 16), (k + 4, 11)) for k in (2, 7, 12, 16))]
    if "spring" in word or "damper" in word or "boucwen" in word:
        return [spring(11)]
    if kind in ("Torque", "Force") or "prescribed" in word:
        arc = [(11 + 8 * math.cos(a), 12 - 8 * math.sin(a)) for a in (math.radians(d) for d in range(200, -41, -20))]
        return [line(*arc), line((arc[-1][0] - 5, arc[-1][1] - 1), arc[-1], (arc[-1][0] + 1.5, arc[-1][1] - 5))]
    if kind == "DeadZone":
        return [line((2, 18), (8, 11), (14, 11), (20, 4)), line((2, 11), (20, 11))]
    if kind == "Saturation":
        return [line((1, 17), (7, 17), (15, 5), (21, 5))]
    if word in ("inertia", "mass", "payload"):
        return [Box("icon", x + 3, y + 4, 16, 14, 2), line((0, 11), (3, 11)), line((19, 11), (22, 11))]
    if kind == "Sum":
        return [ring(11, 11, 9), line((6, 11), (16, 11)), line((11, 6), (11, 16))]
    if kind == "Product":
        return [ring(11, 11, 9), line((7, 7), (15, 15)), line((7, 15), (15, 7))]
    if kind == "Switch":
        return [line((1, 6), (7, 6)), line((1, 16), (7, 16)), line((7, 6), (15, 11)), line((15, 11), (22, 11))]
    if kind == "Quantiser":
        return [line((1, 17), (8, 17), (8, 11), (14, 11), (14, 5), (21, 5))]
    if kind == "RateLimiter":
        return [line((1, 18), (5, 18), (16, 4), (21, 4)), line((5, 18), (5, 4), (16, 4))]
    if kind == "LookupTable":
        return [line((2, 3), (2, 19), (20, 19)), line((4, 16), (8, 9), (13, 11), (19, 4))]
    if kind == "Noise":
        jagged = (11, 6, 15, 9, 3, 17, 8, 13, 5, 11)
        return [line(*((2.0 + 2 * k, float(b)) for k, b in enumerate(jagged)))]
    if folder == "sources":
        wave = [(2 + k, 11 - 7 * math.sin(k / 18 * 2 * math.pi)) for k in range(19)]
        return [line((1, 17), (7, 17), (7, 5), (21, 5))] if kind == "Step" else [line(*wave)]
    if "ripple" in word or "cogging" in word or "vibration" in word:
        wave = [(2 + k, 11 - 5 * math.sin(k / 18 * 6 * math.pi)) for k in range(19)]
        return [ring(11, 11, 9), line(*wave)] if "ripple" in word else [line(*wave)]
    if folder == "sensors":
        dial = [(11 + 9 * math.cos(a), 16 - 9 * math.sin(a)) for a in (math.radians(d) for d in range(180, -1, -15))]
        return [line(*dial, dial[0]), line((11, 16), (16, 9))]
    if folder == "links":
        bent = [(4 + 17 * s, 17 - 11 * s * s) for s in (0, 0.2, 0.4, 0.6, 0.8, 1.0)]
        return [
            ring(3.5, 17, 2.8),
            line(*((a + 1.5, b - 1.5) for a, b in bent)),
            line(*((a, b + 1.5) for a, b in bent)),
        ]
    if folder == "controllers":
        return [Box("icon", x + 2, y + 3, 18, 16, 1), line((5, 15), (9, 8), (17, 7))]
    return [Box("icon", x + 3, y + 4, 16, 14, 1)]
