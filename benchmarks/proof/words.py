"""The words of the page."""

HEAD = """# The proof

Effects are concealed in recordings by code that shares nothing with flexarm (`benchmarks/concealed`), and `flexarm
diagnose` is asked what the nominal model leaves out. Each diagnosis runs in a folder that holds the scenario and
six recordings, nothing else; the answers lie elsewhere and only the scorer opens them. Written by `python -m
benchmarks.proof page`; the cases stand in `benchmarks/results/proof.json`, one line each.

**Rerun one case** and watch the name appear (a few minutes at most; nothing but this repository is needed):

    make setup
    .venv/bin/python -m benchmarks.proof one {example}

{say}. The name of a case says nothing about what is concealed;
any case of the tables below will do, and so will one that nobody has drawn yet:

    .venv/bin/python -m benchmarks.proof one --plant harmonic-arm --effect backlash --size 3 --seed 12345

`make proof` runs eight cases in a few minutes, `make proof FULL=1` all suites; both go on where they were stopped,
and `--scheduler ADDRESS` spreads them over a dask cluster that sees the same folder.
"""

LEGEND = """
*named*: the right name at the right place, and nothing else. *tie*: the truth is among what is reported, and the
truth generator confirms that the recordings cannot tell the rest from it. *none*: rightly nothing. *half*: one of
two. *loose tie*: the truth is in the tie, and so is something that the recordings do exclude. *unknown*: a place
and no name. *missed*: nothing reported. *wrong*, *wrong tie*: a name that is not the truth. In the suite *withheld*
the true effect may not be named, so that *unknown* is what is wanted; *equal*: it named another law instead, which by
the truth generator's own computation does the same on these recordings to within the noise floor (friction that
differs between the directions, with both the same, is Coulomb friction). *equal* is also a part of what is concealed
that by that computation does the same as the whole, to a hundredth of the floor: a dead zone with unequal ends is one
with an offset before it.
"""

SINDY = """The discrepancy approach [Kaheman 2019], as we understand it: angles and speeds from the sensors by
smoothed differentiation; the acceleration that the nominal model leaves over; what is linear in q, v and u, as errors
of parameters are, fitted first; a sparse regression of the rest on a library (1, sign v, v|v|, q^3, sin and cos n q,
sign u, |u|, joint twist cubed). It needs no simulation and takes a second. It gives a term and no place; where the
effect is a hidden state or memory (delay, lag, play, a further mode or joint) the library has no term for it. A sine
or cosine of any order counts as gravity or ripple. Its smoothing and thresholds were tuned in its favour on cases of
development; somebody who knows it better may get more from it. With nothing concealed, *selected* counts the cases in
which it selects no term.

"""

POWER = """Right name, or a correct tie, against the size of the effect. One detection threshold is the size at which
what a refit of the nominal parameters leaves of the effect is as large as the noise floor.

"""

CONFUSION = """## Concealed against reported

All cases that conceal one thing or nothing, whatever their sensors and sizes. A tie is counted as *tie*, also where
it is right; *several*: more than one finding.

"""

HELD_OUT = """## Held-out error before and after

Medians of the mean square over the noise floor on three recordings of kinds that nothing was fitted to; 1 is the
sensors' noise. The refit alone, parameters without diagnosis, is the first peer. The floor is the true one where
the scenario states another.

"""

INTERVALS = """## Intervals

How many of the 95 % intervals hold the true value, where the tool reports the quantity that the truth has. Levels
behind the amplifier are compared at the command (its gain is off by up to 5 %).

"""

GOALS = """## What must be shown

Rates with 95 % bounds (Wilson). A diagnosis tells what it has found after 200 s (`flexarm diagnose --longest`, which
counts operations). Cases that could not be drawn, failed, were stopped after 300 s of processor time or were not run
count as failures.

"""

TIME = """## Time per diagnosis

Six recordings of 4 s at 1 kHz, three to train; one thread, compiling included. The machine did other work beside it, so
that the processor time is what counts: on a core of its own a diagnosis takes as long.

"""
