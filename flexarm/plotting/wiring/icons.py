"""Small signs in the boxes of a block diagram, 22 by 22, by type of block or else by its folder of the library."""

from __future__ import annotations

import math

from flexarm.plotting.wiring.shapes import Box, Disc, Label, Poly, Shape

SIZE = 22.0


def icon(kind: str, folder: str, x: float, y: float) -> list[Shape]:
    """The sign of a block of type ``kind`` with its upper left corner at a point."""

    def line(*points: tuple[float, float]) -> Poly:
        return Poly("icon", tuple((x + a, y + b) for a, b in points))

    def ring(a: float, b: float, radius: float) -> Disc:
        return Disc("icon", x + a, y + b, radius)

    def spring(height: float) -> Poly:
        zigzag = [(5.0 + 2 * k, height + (3.5 if k % 2 else -3.5)) for k in range(1, 6)]
        return line((0, height), (5, height), *zigzag, (17, height), (22, height))

    word = kind.lower()
    if kind == "DCMotor":
        return [ring(11, 11, 9), Label("icon-text", x + 11, y + 15, "M", 11, "middle")]
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
    if "friction" in word or word in ("brake", "lugre", "elastoplastic"):
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
    if kind in ("Relay", "Quantiser"):
        return [line((1, 17), (8, 17), (8, 11), (14, 11), (14, 5), (21, 5))]
    if kind == "RateLimiter":
        return [line((1, 18), (5, 18), (16, 4), (21, 4)), line((5, 18), (5, 4), (16, 4))]
    if kind in ("LookupTable", "LookupTable2D", "GainSchedule", "Curve"):
        return [line((2, 3), (2, 19), (20, 19)), line((4, 16), (8, 9), (13, 11), (19, 4))]
    if kind == "Noise":
        jagged = (11, 6, 15, 9, 3, 17, 8, 13, 5, 11)
        return [line(*((2.0 + 2 * k, float(b)) for k, b in enumerate(jagged)))]
    if folder == "sources":
        wave = [(2 + k, 11 - 7 * math.sin(k / 18 * 2 * math.pi)) for k in range(19)]
        return [line((1, 17), (7, 17), (7, 5), (21, 5))] if kind in ("Step", "Pulse", "Constant") else [line(*wave)]
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
