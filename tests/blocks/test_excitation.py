"""Excitation signals: chirp, multisine and pseudo-random binary sequence, by what they are made for."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate

from blocks.actuators.effort import Torque
from blocks.links.inertia import Inertia
from blocks.sources.chirp import Chirp
from blocks.sources.multisine import Multisine
from blocks.sources.prbs import PRBS, TAPS
from engine.block import Block
from engine.errors import ParameterError
from engine.simulate import Result
from tests.blocks.assembly import instants, run


def alone(source: Block, stop: float, step: float) -> Result:
    return run({"source": source}, stop=stop, step=step, energy=False)


@pytest.mark.parametrize("law", ["linear", "logarithmic"])
@pytest.mark.parametrize(("f0", "f1"), [(0.5, 9.0), (7.0, 0.3), (2.0, 2.0)])
def test_chirp_frequency(law: str, f0: float, f1: float) -> None:
    """The phase is the integral of the frequency, found here by quadrature."""
    start, duration, amplitude, offset, phase = 0.217, 3.0, 0.7, 0.1, 0.4
    source = Chirp(
        amplitude=amplitude, start_frequency=f0, end_frequency=f1, duration=duration, start=start, offset=offset,
        phase=phase, law=law,
    )  # fmt: skip
    result = alone(source, 4.0, 0.01)

    def frequency(x: float) -> float:
        return f0 + (f1 - f0) * x if law == "linear" else f0 * (f1 / f0) ** x

    for k in range(0, 401, 13):
        x = (result.time[k] - start) / duration
        inside = 0 <= x < 1
        cycles = duration * integrate.quad(frequency, 0, x)[0] if inside else 0.0
        expected = amplitude * np.sin(2 * np.pi * cycles + phase) if inside else 0.0
        assert result["source.out"][k] == pytest.approx(offset + expected, abs=1e-9)
    np.testing.assert_allclose(instants(result, "source.phase"), [start, start + duration], atol=1e-14)


def test_chirp_edges_are_met_between_steps() -> None:
    """A torque on an inertia: its speed at the end is the integral of the wave, though no row meets an edge."""
    source = Chirp(amplitude=2.0, start_frequency=1.0, end_frequency=3.0, duration=1.111, start=0.3333)
    parts: dict[str, Block] = {"source": source, "torque": Torque(), "body": Inertia(inertia=0.5)}
    result = run(parts, "source.out torque.torque", "torque.shaft body.shaft", stop=2.0, step=0.005, energy=False)

    def wave(t: float) -> float:
        return 2.0 * float(np.sin(2 * np.pi * 1.111 * (t / 1.111 + (t / 1.111) ** 2)))

    area = integrate.quad(wave, 0, 1.111, epsabs=1e-13)[0]
    assert result["body.shaft.speed"][-1] == pytest.approx(area / 0.5, abs=1e-8)


def test_multisine_has_the_lines_asked_for() -> None:
    amplitudes = [1.0, 0.5, 2.0, 0.25]
    source = Multisine(base_frequency=0.5, lines=4, first=3, spacing=2, amplitude=amplitudes, offset=0.3)
    result = alone(source, 2.0, 2.0 / 128)
    spectrum = np.fft.rfft(result["source.out"][:-1]) / 64
    expected = np.zeros(65)
    expected[[3, 5, 7, 9]] = amplitudes
    expected[0] = 2 * 0.3
    np.testing.assert_allclose(np.abs(spectrum), expected, atol=1e-12)
    schroeder = [-np.pi * k * (k - 1) / 4 for k in range(1, 5)]
    np.testing.assert_allclose(np.exp(1j * np.angle(spectrum[[3, 5, 7, 9]])), np.exp(1j * np.array(schroeder)))


def test_multisine_phases_and_their_peaks() -> None:
    def crest(phases: str, seed: int = 1) -> float:
        source = Multisine(base_frequency=1, lines=32, phases=phases, seed=seed, amplitude="1 V")
        values = alone(source, 1.0, 1.0 / 2048)["source.out"][:-1]
        return float(np.abs(values).max() / np.sqrt(np.mean(values**2)))

    assert crest("zero") == pytest.approx(np.sqrt(2 * 32), rel=1e-12)
    assert crest("schroeder") < 1.8
    assert 1.8 < crest("random") < 5
    assert crest("random", 2) != crest("random")
    assert crest("random", 2) == crest("random", 2)


def powers(exponent: int, taps: tuple[int, ...]) -> int:
    """x to a power modulo the polynomial 1 + sum x^tap over GF(2), bit k being the coefficient of x^k."""
    n = max(taps)
    modulus = 1 | sum(1 << tap for tap in taps)
    result, base = 1, 2
    while exponent:
        if exponent & 1:
            result = times(result, base, modulus, n)
        base = times(base, base, modulus, n)
        exponent >>= 1
    return result


def times(a: int, b: int, modulus: int, n: int) -> int:
    product = 0
    while b:
        if b & 1:
            product ^= a
        b >>= 1
        a <<= 1
        if a >> n & 1:
            a ^= modulus
    return product


def primes_of(number: int) -> set[int]:
    found, p = set(), 2
    while p * p <= number:
        while number % p == 0:
            found.add(p)
            number //= p
        p += 1
    return found | ({number} if number > 1 else set())


@pytest.mark.parametrize("order", TAPS)
def test_every_prbs_has_the_longest_period(order: int) -> None:
    """The feedback polynomial is primitive: x has the order 2^n - 1 and no divisor of it."""
    period = 2**order - 1
    assert max(TAPS[order]) == order
    assert powers(period, TAPS[order]) == 1
    for prime in primes_of(period):
        assert powers(period // prime, TAPS[order]) != 1


@pytest.mark.parametrize(("order", "seed"), [(2, 1), (5, 1), (5, 17), (7, 100), (9, 3)])
def test_prbs_autocorrelation(order: int, seed: int) -> None:
    """1 at lag zero, -1 / N at every other; balance 2^(n - 1) against one less; and it repeats."""
    n, bit = 2**order - 1, 0.02
    result = alone(PRBS(amplitude=1.5, bit=bit, order=order, seed=seed, offset=0.25), (2 * n - 1) * bit, bit)
    value = (result["source.out"] - 0.25) / 1.5
    np.testing.assert_allclose(np.abs(value), 1.0)
    np.testing.assert_array_equal(value[n:], value[: len(value) - n])
    one = value[:n]
    assert (one > 0).sum() == 2 ** (order - 1)
    assert one[0] == 2 * (seed & 1) - 1
    correlation = np.fft.ifft(np.abs(np.fft.fft(one)) ** 2).real / n
    np.testing.assert_allclose(correlation, [1.0, *[-1 / n] * (n - 1)], atol=1e-12)


def test_prbs_values_change_at_the_bits_alone() -> None:
    bit = 0.03
    result = alone(PRBS(bit=bit, order=4), 0.9, 0.005)
    changes = result.time[1:][np.diff(result["source.out"]) != 0]
    assert len(changes) > 8
    np.testing.assert_allclose(changes / bit, np.round(changes / bit), atol=1e-9)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PRBS(bit=0.1, order=4, seed=16), r"seed = 16 does not fit 4 stages\n  give 1 to 15"),
        (lambda: PRBS(bit=0.1, order=1), "1 is out of range: order"),
        (lambda: Multisine(base_frequency=1, lines=3, amplitude=[1, 2]), "amplitude has 2 values"),
        (lambda: Chirp(start_frequency=0, end_frequency=1, duration=1), "start_frequency must be > 0 Hz"),
    ],
)
def test_refusals(make: object, message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        make()  # type: ignore[operator]
