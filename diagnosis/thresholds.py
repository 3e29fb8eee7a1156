"""Every number that decides something in a diagnosis: value, unit, reason, and what set it.

The page of rules in the documentation is made from here. Tolerances of numerical methods stand beside the method.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


def number(value: Any, unit: str, reason: str, set_by: str) -> Any:
    """A number of a rule.

    Args:
        value: it.
        unit: of the value; ``1`` for a share.
        reason: why there is such a number.
        set_by: the decision record, or the cases on which the value was found, with the commit that set it.
    """
    return field(default=value, metadata={"unit": unit, "reason": reason, "set_by": set_by})


@dataclass(frozen=True)
class Noise:
    """What is noise, and what chance does."""

    fewest: int = number(
        64,
        "samples",
        "With fewer samples no frequency stands out of what is left over.",
        "the rules drawn together on 100 cases (ea5630f)",
    )


@dataclass(frozen=True)
class Fitting:
    """How a model is fitted to recordings."""

    huge: float = number(
        1000000.0,
        "standard deviations",
        "Bound on a residual: a simulation that runs away counts as this.",
        "first cases of the truth generator (09d7d5d)",
    )
    settled: float = number(
        0.1,
        "mean squared residuals",
        "A fit has converged when a full step would gain less than this: the evidence would change by a twentieth.",
        "evidence of one recorded value",
    )
    stalled: float = number(
        0.0001,
        "1",
        "Where no step gains anything, a fit has converged if it promised less than this share of the sum of squares.",
        "first cases of the truth generator (09d7d5d)",
    )
    radius: float = number(
        3.0,
        "tolerances",
        "Length of the first step at most: parameters are believed to be about this close.",
        "prior of the tolerances",
    )
    alike: float = number(
        0.3,
        "1",
        "Standard deviation of the logarithm of the ratio of two sizes that are expected to be equal.",
        "suite 'pairs' (15b161c)",
    )
    pace: int = number(
        3,
        "steps",
        "Steps whose gain tells what those to come will gain, at most, of a fit that is to reach a cost.",
        "one step may be cut short by its region; a valley's next bend shows within a few",
    )
    longer: float = number(
        1.5,
        "1",
        "A step that should be so many times as long is tried at that length; the next gains what shorter ones miss.",
        "a parabola's minimum is missed by a ninth of the gain",
    )
    straight: float = number(
        0.5,
        "1",
        "A step that gains this share of what the linear model promises is not bent, and the next may be longer.",
        "99 fits of random rigs 7400 to 7417: as many at the bottom as with 0.75, with less work",
    )
    held_over: float = number(
        0.1,
        "tolerances",
        "Distance over which a run's tangents must foretell how it changes, as a step of a fit that still gains does.",
        "four random rigs: of smooth models tangents miss less than 1 % there, where contacts bounce more than all",
    )
    foretold: float = number(
        0.5,
        "1",
        "Share of a change, in squares, that tangents may miss: else they point elsewhere.",
        "half of a change is foretold by nothing",
    )
    tries: int = number(
        3,
        "steps",
        "Steps, each a quarter as long, that gain nothing before it is asked whether tangents hold.",
        "a real arm's second mode: near a resonance tangents hold over less than that, and lead there",
    )
    secants: tuple[float, ...] = number(
        (1.0, 0.25, 0.06),
        "tolerances",
        "Distances to either side over which secants are taken, the next one where no step gains any more.",
        "eight fits of random rigs 41572, 550449 and 836028: of four schedules the least cost in all, and time",
    )
    first_horizon: float = number(
        0.25,
        "1",
        "A fit from afar begins with this share of each recording: over it no oscillation slips by a whole cycle.",
        "tables and recordings of others (59a88f6)",
    )
    first_samples: int = number(
        16,
        "samples",
        "A parabola through these gives the slope at the start of a recording.",
        "tables and recordings of others (59a88f6)",
    )
    first_rows: int = number(
        32,
        "rows",
        "A sample that comes later says nothing of the start: the machine has moved on.",
        "random rig 23, of which one recording was split",
    )
    usual_start: float = number(
        0.05,
        "SI",
        "Scale of a starting value that no measurement speaks of, such as the twist of a joint.",
        "tables and recordings of others (59a88f6)",
    )
    start_reach: float = number(
        4.0,
        "standard deviations",
        "A starting value that is measured goes no farther from its sample.",
        "a normal deviate beyond it is one in 16 000",
    )
    most_samples: int = number(
        1000000,
        "samples",
        "A fit simulates all of them some hundred times.",
        "tables and recordings of others (59a88f6)",
    )
    finest: int = number(
        8,
        "steps per sample",
        "What moves faster than this many integration steps can follow, the data cannot show.",
        "the rules drawn together on 100 cases (ea5630f)",
    )
    visited: int = number(
        500,
        "rows",
        "States of a run among which the stiffest is looked for: a swing that is resolved lasts longer than a row.",
        "random rig 581250",
    )
    stable: float = number(
        2.0,
        "1",
        "A mode is integrated stably while its rate times the step stays below this.",
        "stability limit of RK4 on the real axis is 2.78",
    )


@dataclass(frozen=True)
class Tables:
    """Frequency-response tables, whose few rows are costly to simulate."""

    difference: float = number(
        0.02,
        "tolerances",
        "Difference of the search variable for derivatives.",
        "tables and recordings of others (59a88f6)",
    )
    kept: int = number(
        2,
        "steps",
        "A Jacobian serves this many further steps.",
        "tables and recordings of others (59a88f6)",
    )
    near: float = number(
        0.6,
        "tolerances",
        "Length of a step after which a Jacobian is computed anew.",
        "tables and recordings of others (59a88f6)",
    )
    credible: float = number(
        3.0,
        "standard deviations",
        "Beyond it the cost of a held-out reading grows in proportion: one may be misread or misprinted.",
        "tables and recordings of others (59a88f6)",
    )
    latest: int = number(
        16,
        "evaluations",
        "Answers that are kept, for a fit asks for them twice.",
        "tables and recordings of others (59a88f6)",
    )
    fewest: int = number(
        4,
        "rows",
        "Rows that a table needs to be fitted to.",
        "tables and recordings of others (59a88f6)",
    )
    factors: tuple[float, ...] = number(
        (0.3, 0.5, 2.0, 3.0),
        "1",
        "Factors by which a parameter of a table's model may be wrong, to start from: a few rows leave a "
        "fit in local optima.",
        "suite 'wrong' and the tables of the SRV02 (b637a21)",
    )


@dataclass(frozen=True)
class Intervals:
    """How uncertain a fitted parameter is."""

    block: float = number(
        0.25,
        "s",
        "Blocks within which residuals are taken to be correlated.",
        "ADR 11",
    )
    input_size: float = number(
        0.03,
        "1",
        "Standard deviation of the input's size: no amplifier is calibrated better.",
        "ADR 11",
    )
    input_timing: float = number(
        0.1,
        "samples",
        "Standard deviation of the input's instants.",
        "ADR 11",
    )
    least_left: float = number(
        0.02,
        "noise power",
        "What a model leaves out, at least.",
        "ADR 11",
    )
    most_left: float = number(
        1.0,
        "noise power",
        "What a model leaves out, at most.",
        "ADR 11",
    )
    left_length: float = number(
        0.5,
        "s",
        "How long what is left out keeps its sign.",
        "ADR 11",
    )
    reach: float = number(
        40.0,
        "tolerances",
        "A cost that is flat is followed this far.",
        "ADR 11",
    )
    rise: float = number(
        3.84,
        "1",
        "Rise of the cost at the end of a 95 % interval.",
        "chi-square of one freedom at 95 %",
    )
    close: float = number(
        0.01,
        "1",
        "Relative accuracy of such an end.",
        "ADR 11",
    )


@dataclass(frozen=True)
class Coarse:
    """How coarse recordings are made while many models are looked at."""

    samples: int = number(
        4000,
        "samples",
        "Recordings to fit that hold no more together are used as they are: fewer save little time.",
        "random rigs 0 to 29",
    )
    varies: float = number(
        0.2,
        "1",
        "Share of an input's variance between coarse samples: a dead zone would answer the mean in another way.",
        "random rigs 0 to 29",
    )
    hidden: float = number(
        0.1,
        "1",
        "Share of what the refitted model leaves over, and of the noise, that may be faster than the coarse samples.",
        "random rigs 0 to 29",
    )
    error: float = number(
        0.001,
        "1",
        "What the samples may be corrected by, as a share of a signal's variance: the correction is to be small.",
        "random rigs 0 to 29",
    )
    per_rate: float = number(
        1.0,
        "1",
        "Integration step times the fastest rate, at most: RK4 then turns a mode by a hundredth less than it should.",
        "series of RK4's stability function",
    )
    solver: float = number(
        0.1,
        "standard deviations of the noise",
        "Error of long integration steps, root mean square of any signal: it adds one part in a hundred to the noise.",
        "a part in a hundred is below what a hundred samples show",
    )


@dataclass(frozen=True)
class Evidence:
    """How much recordings speak for a model, and when an effect is named."""

    fewest: int = number(
        4,
        "values",
        "Fewest cosines in a band of frequency: the strength of noise is not known from less.",
        "the whitening of residuals; ADR 18",
    )
    chance: float = number(
        3.0,
        "standard deviations",
        "A band that shows less than this beyond the sensor's noise shows nothing.",
        "the whitening of residuals; ADR 18",
    )
    hair: float = number(
        0.003,
        "tolerances",
        "Distance between two models that nobody could tell apart: nuisances that no model has move a run as far.",
        "a third of a thousandth of a parameter that is known to 10 %",
    )
    stated: float = number(
        2.0,
        "noise power",
        "A sensor's noise is at most this many times as strong as it was stated to be.",
        "the noise of random rigs is wrong by up to 30 %",
    )
    share: float = number(
        0.02,
        "1",
        "What an effect must account for, as a share of all that any model explains: nuisances are that large.",
        "in the suites of the proof ripples and windings nobody asked for account for 0.5 to 1.1 % beside effects of "
        "three thresholds; of right pairs none less than 4 %, but those that end at the noise",
    )
    several: float = number(
        0.1,
        "1",
        "Nuisances are several: what is no nuisance may leave this share of what is left without it, if that is small.",
        "random rigs and suites of the proof: nuisances leave 20 to 90 %, second effects of right pairs 2 % at most",
    )
    rough: float = number(
        0.05,
        "1",
        "The same where the model's fit has not converged: what such a fit leaves is not missing physics.",
        "bouncing contacts of random rigs",
    )
    temperature: float = number(
        4.0,
        "1",
        "Divides the evidence of one effect over another: what no model has may tilt it, and claims must be met.",
        "random rigs: of 7 claims that were 3 to 9 units likelier than a rival, which 1 calls 0.95 or more, 4 right",
    )
    lots: int = number(
        64,
        "values",
        "Where contacts bounce, probabilities are averaged over so many equally likely values of what luck adds.",
        "a 64th is a third of the 5 % that a claim leaves to rivals",
    )
    probability: float = number(
        0.95,
        "1",
        "From this probability an effect is named, and rivals that hold the rest are not mentioned.",
        "what users expect of 95 %",
    )
    most: float = number(
        0.5,
        "1",
        "A name explains at least this share of the held-out mismatch.",
        "more than half is most",
    )
    imitated: float = number(
        0.9,
        "1",
        "The same where more is left than a sensor's noise: what explains less may imitate what nobody lists.",
        "11 pages of random rigs, claims above twice the noise: 6 of 12 that leave more are right, 19 of 20 others",
    )


@dataclass(frozen=True)
class Search:
    """How far the search goes; more of each costs time and finds no less."""

    most: int = number(
        3,
        "effects",
        "Effects that are sought together.",
        "random rigs conceal up to three",
    )
    effort: float = number(
        3.0,
        "evidence",
        "What a further effect could gain at most, beyond its price, for a search to be worth its time.",
        "odds of twenty to one",
    )
    patience: float = number(
        1.0,
        "1",
        "A search ends that has gained nothing for so many times the work that it took to find what leads.",
        "as long again; in six random rigs that conceal several effects each of them came sooner (ADR 49)",
    )
    least_work: int = number(
        30_000_000_000,
        "operations",
        "Work for which it goes on after a gain in any case, about half a minute of processor time.",
        "that is worth a third effect; in random rig 194213 one was 47 s behind the second, before tangents counted",
    )
    second: int = number(
        1_000_000_000,
        "operations",
        "Work that counts as a second of the time that is allowed, with all that is not counted.",
        "eight random rigs (among them 606961, 607522, 374605) did 740 to 1500 million in a second (ADR 58)",
    )
    look: int = number(
        40_000_000,
        "operations",
        "Work that an effect that is looked at counts for, beside its runs: to put it in and to work out its courses.",
        "of five random rigs a model takes 5 to 29 ms to build, and an effect two models",
    )
    first: float = number(
        1 / 3,
        "1",
        "Share of the time that is allowed, if any, after which first effects wait until others stand beside them.",
        "as many rounds as effects are sought together, and each is to have its turn",
    )
    growing: float = number(
        2 / 3,
        "1",
        "Share of the time that is allowed, if any, after which no further effect is added: the rest goes into rivals.",
        "random rigs 988510 and 705067, two effects each: three quarters and two thirds of their time",
    )
    samples: int = number(
        4000,
        "samples",
        "Samples of the fitted recordings on which effects are screened.",
        "long recordings (2f0e384)",
    )
    factor: float = number(
        3.0,
        "1",
        "An effect's course is taken to grow in proportion within this factor of a size that was simulated.",
        "distance between starting sizes",
    )
    alike: float = number(
        2.0,
        "1",
        "Ratio of the powers of two courses up to which neither is the smaller: those of a size and its negative.",
        "random rigs 38 and 39",
    )
    factor_of_two: float = number(
        30.0,
        "1",
        "The same for two effects together, which hide each other.",
        "suite 'pairs' (15b161c)",
    )
    promised: float = number(
        30.0,
        "1",
        "Gains may be so many times as large as promised: what would not come near the best model then is not fitted.",
        "random rigs 408365, 143133, 122417, 418829, 8721: of 20 models near the best none gained more than 15 times",
    )
    farthest: float = number(
        3.0,
        "tolerances",
        "A parameter moves at most this far in the linear solution.",
        "ripple and gravity of suite 'catalogue' (137926e)",
    )
    sizes: int = number(
        6,
        "sizes",
        "Sizes of an effect, those that promise most alone, at which it is paired with others.",
        "suite 'pairs' (15b161c)",
    )
    pairs: int = number(
        30,
        "pairs",
        "Pairs of effects whose likelihood is worked out, those that take most of the residual away.",
        "in two pairs of the proof and random rigs 988510 and 802284 the right ones were among the first eleven",
    )
    places: int = number(
        2,
        "places",
        "Places at which the pair of two effects is tried.",
        "suite 'pairs' (7f79900)",
    )
    starts: int = number(
        2,
        "starting sizes",
        "Starting sizes of an effect that are fitted.",
        "suite 'catalogue' (544f6d4)",
    )
    fitted: int = number(
        14,
        "effects",
        "Effects that are fitted beside a model, those that promise most.",
        "random rigs",
    )
    fitted_beside: int = number(
        8,
        "effects",
        "The same beside effects that are in already.",
        "random rigs",
    )
    beside: int = number(
        30,
        "effects",
        "Effects that are looked at beside others, those that promised most alone.",
        "random rigs",
    )
    cuts: int = number(
        6,
        "cuts",
        "Ways to cut the machine at which every law of a joint is looked at, those that promise most with one law.",
        "random rigs 0 to 29",
    )
    exchanged: int = number(
        6,
        "effects",
        "Effects that are tried in the place of one of a model, besides those that act there or are of its kind.",
        "random rigs",
    )
    likest: float = number(
        0.9,
        "1",
        "From this cosine between what two effects change of the recordings, one is tried in the place of the other.",
        "a delay beside Coulomb friction (rig 904724)",
    )
    retries: int = number(
        6,
        "fits",
        "Fits of the best model from points around where it ended, if it did not converge.",
        "bouncing contacts of random rigs",
    )
    around: float = number(
        0.3,
        "tolerances",
        "Distance of these points, in each direction.",
        "bouncing contacts of random rigs",
    )
    first_steps: int = number(
        6,
        "steps",
        "Steps from each of the best starts.",
        "the rules drawn together on 100 cases (ea5630f)",
    )
    beginning: float = number(
        1 / 32,
        "1",
        "Share of each recording to which a model is fitted first, before it is fitted to ever more.",
        "cogging of 18 and 36 waves a turn, 300 thresholds, on a geared motor: from 1/16 on the higher is lost",
    )
    early: float = number(
        1 / 16,
        "1",
        "Share of each recording, from its beginning on, over which pairs of effects are looked at too.",
        "friction and cogging, 300 thresholds, on two plants: of the first eight pairs on both; at 1/32 on one",
    )
    telling: float = number(
        1 / 8,
        "1",
        "Share of each recording from which on the half of a wave's orders that leaves more is dropped.",
        "over less of it, neighbouring orders are alike",
    )
    lost: float = number(
        2.0,
        "1",
        "A recording is lost by a fit that leaves so many times what it left of half as much, or of a coarse one.",
        "as a sensor's noise; of a coarse one cogging beside friction leaves 60 times as much, a recorded damper 1.002",
    )
    stride: float = number(
        1 / 16,
        "octaves",
        "The least by which more of a recording is fitted at a time, once it was lost in longer strides.",
        "Coulomb friction and cogging, 300 thresholds, on two masses: lost for good at 1/4, followed to the end at 1/8",
    )
    bold_steps: int = number(
        60,
        "steps",
        "The same from the largest size, where the model's own parameters have to make room first.",
        "second mode of a real arm",
    )
    drawn: float = number(
        2.0,
        "tolerances",
        "Parameters that are bent for want of an effect are drawn back to this before another is put in.",
        "parameters are believed to be about a tolerance off",
    )
    finished: int = number(
        8,
        "models",
        "Models of one effect, and of two at once, that are fitted to the end.",
        "random rigs",
    )
    few: int = number(
        3,
        "models",
        "Models of a further effect that are fitted at a time, and of two at once that are fitted to the end.",
        "random rigs 20 to 44",
    )
    slow: float = number(
        1.0,
        "mean squared residuals",
        "A fit is left where a step lowers its cost by less, until its model turns out to be the best.",
        "half a unit of evidence; odds of twenty to one are six of these",
    )
    digits: float = number(
        1e-3,
        "1",
        "The user's own model is fitted until a step takes less than this share of its squared error away.",
        "an error is told in three digits",
    )
    settled: int = number(
        4,
        "models",
        "Models that are fitted to the end at last, those that are worth most.",
        "random rigs 0 to 29",
    )
    most_steps: int = number(
        100,
        "steps",
        "Steps of a fit to the end.",
        "table of optimisers",
    )
    beam: int = number(
        3,
        "models",
        "Models of two effects that are extended by a third one, if they are near the best.",
        "random rigs",
    )
    parents: int = number(
        6,
        "models",
        "Models of one effect that are extended before a third effect is sought.",
        "random rigs 7100 to 7139",
    )
    finer: tuple[float, ...] = number(
        tuple(0.5**k for k in range(1, 11)),
        "distances between starting sizes",
        "To either side, at which a size that is only chosen, a delay, is looked for: the next where tangents bend.",
        "delays of suite 'core' (ad31092)",
    )
    bend: float = number(
        0.5,
        "1",
        "Share of its slope that what is left may bend by between two such values, for a step on that slope.",
        "where a simulation fails on one side, or two answers have nothing in common, it bends as much as it slopes",
    )
    slope_step: float = number(
        0.5**7,
        "distances between starting sizes",
        "Distance at which a size that is only chosen is moved to see what the residual owes to it.",
        "well above rounding, well below the finest that is told",
    )
    lines: int = number(
        3,
        "frequencies",
        "Frequencies of what is left over that are tried as a vibration from outside, and as a further mode.",
        "the rules drawn together on 100 cases (ea5630f)",
    )
    part: float = number(
        0.5,
        "s",
        "Parts into which a recording is cut that alone shows a mismatch.",
        "pairs that hide each other (f8fedfc)",
    )


@dataclass(frozen=True)
class Tones:
    """Which frequencies stand out in what is left over."""

    finer: int = number(
        4,
        "1",
        "Lines of a padded spectrum for one of the plain spectrum.",
        "an oscillation is followed through a recording only from a fraction of a line away (random rig 8703)",
    )
    around: int = number(
        16,
        "lines",
        "Lines of the plain spectrum, at least, whose median is what is around one of them; else a third of an octave.",
        "a median of fewer is raised by a tone itself, which is four lines wide",
    )
    apart: int = number(
        2,
        "lines",
        "Lines of the plain spectrum by which two tones differ at least, and the lowest one from a drift.",
        "half the width of a peak behind a window of Hann's",
    )


@dataclass(frozen=True)
class Recovery:
    """How a missing force is recovered without a name."""

    knot: float = number(
        0.024,
        "s",
        "Time between the knots of the recovered force.",
        "the rules drawn together on 100 cases (ea5630f)",
    )
    rows_per_knot: int = number(
        4,
        "samples",
        "Samples of the residual that are kept for each knot.",
        "the rules drawn together on 100 cases (ea5630f)",
    )
    bins: int = number(
        15,
        "points",
        "Points of a curve.",
        "the rules drawn together on 100 cases (ea5630f)",
    )
    loose: float = number(
        1.5,
        "tolerances",
        "How far a parameter may have moved.",
        "the rules drawn together on 100 cases (ea5630f)",
    )
    heights: int = number(
        21,
        "points",
        "Heights of a curve that is put in: enough that a jump, such as dry friction's, is not smeared "
        "over the whole range.",
        "suite 'withheld' (b637a21)",
    )
    unknown: float = number(
        100.0,
        "largest heights",
        "Standard deviation of a height before it is fitted: nothing is known of it, and a prior that held it would "
        "have the user's parameters make up for it.",
        "drag against the back electromotive force",
    )
    bend: float = number(
        1.0,
        "largest heights",
        "Standard deviation of a height about the line through the two before it: a law goes on as it was, or jumps, "
        "as dry friction does, by twice the largest height. Heights that know nothing of each other follow the noise "
        "between the values that an input takes.",
        "an offset withheld from the catalogue, behind an input of many steps (random rig 7215)",
    )
    places: int = number(
        2,
        "places",
        "Places where a curve is tried: the effect that does best may be one that bends parameters elsewhere.",
        "suite 'withheld' (b68ec5a), and a drag beside a limit of the current",
    )
    curves: int = number(
        2,
        "curves",
        "Quantities that it may depend on, at each place.",
        "suite 'withheld' (b68ec5a)",
    )


@dataclass(frozen=True)
class Wording:
    """What a sentence mentions."""

    left: float = number(
        2.0,
        "floors",
        "Held-out error beyond which a sentence about a tie says what is left.",
        "pairs that hide each other (f8fedfc)",
    )
    far: float = number(
        3.0,
        "tolerances",
        "Distance of a fitted parameter from the value given that is mentioned.",
        "first cases of the truth generator (09d7d5d)",
    )
    unit: float = number(
        0.02,
        "1",
        "A sensor's scale within this share, in the logarithm, of that between two units is mentioned.",
        "tables and recordings of others (59a88f6)",
    )
    few_rows: int = number(
        8,
        "rows",
        "A table with fewer rows is said to be short.",
        "tables and recordings of others (59a88f6)",
    )
    absorbed: float = number(
        3.0,
        "floors",
        "Nominal error from which parameters are said to have absorbed a mismatch.",
        "tables and recordings of others (59a88f6)",
    )
    moved: float = number(
        0.005,
        "1",
        "Change of a parameter that is mentioned then.",
        "tables and recordings of others (59a88f6)",
    )
    seen: float = number(
        5.0,
        "standard deviations",
        "A sample this far from zero is no noise: a signal that has some on either side goes both ways.",
        "noise alone passes it once in two million samples",
    )


@dataclass(frozen=True)
class RecordingChecks:
    """What is odd about a recording."""

    alike: float = number(
        0.8,
        "1",
        "Correlation of measured and simulated signal from which their ratio means something.",
        "tables and recordings of others (59a88f6)",
    )
    near: float = number(
        0.12,
        "1",
        "A ratio within this share of a unit's is taken for it.",
        "tables and recordings of others (59a88f6)",
    )
    farthest: int = number(
        16,
        "samples",
        "Shift of a column that is looked for.",
        "tables and recordings of others (59a88f6)",
    )
    halved: float = number(
        0.35,
        "1",
        "A shift is reported if it leaves this share of the residual, or less.",
        "tables and recordings of others (59a88f6)",
    )
    run: int = number(
        5,
        "samples",
        "Equal samples in a row, at the extreme of a signal, that may be clipping.",
        "tables and recordings of others (59a88f6)",
    )
    approach: int = number(
        3,
        "samples",
        "By these a run of equal samples is entered and left: their mean is the speed.",
        "a joint held still by friction against a clipped sine",
    )
    gain: float = number(
        0.26,
        "1",
        "Logarithm of a factor common to all signals from which the drive's scale is in doubt.",
        "parameters are known to 10 %, a product of them to 30 %",
    )
    one_gain: float = number(
        0.15,
        "1",
        "Range of the logarithms of factors that are one.",
        "a drive logged at half its value",
    )
    way: float = number(
        0.01,
        "1",
        "Logarithm of the way of a position over that of its speed, from which one of them is in doubt.",
        "a clock 2 % off",
    )
    odd_way: float = number(
        1e-3,
        "1",
        "Share of the way's power that may be left for the factor to mean anything.",
        "a clock 2 % off",
    )
    clock: float = number(
        0.003,
        "1",
        "Rate of a clock that is in doubt.",
        "crystals keep 1e-4, software timers a few per mille",
    )
    clock_rates: tuple[float, ...] = number(
        (0.005, 0.01, 0.02, 0.03, 0.05),
        "1",
        "Rates of a clock that are tried, in both directions.",
        "phase over the memory of an oscillation is linear for half a step of these",
    )
    clock_step: float = number(
        0.001,
        "1",
        "Difference of the clock's rate for derivatives.",
        "phase over a thousand periods changes by less than a radian in a sixth of them",
    )
    level: float = number(
        0.2,
        "1",
        "Scatter of a table about a constant factor, as a share of it in dB, up to which the factor counts.",
        "tables and recordings of others (59a88f6)",
    )
    abrupt: float = number(
        0.5,
        "1",
        "A run at an extreme is clipping if it is entered or left at this share of the usual speed.",
        "tables and recordings of others (59a88f6)",
    )
    beyond: float = number(
        0.03,
        "1",
        "Share of the signal's range by which the model must go beyond the extreme.",
        "tables and recordings of others (59a88f6)",
    )


@dataclass(frozen=True)
class NextExperiment:
    """Which experiment is proposed."""

    duration: float = number(
        6.0,
        "s",
        "Length of an input.",
        "first cases of the truth generator (09d7d5d)",
    )
    step: float = number(
        0.001,
        "s",
        "Time between its values.",
        "suite 'ties' (0762a7f)",
    )
    quick: float = number(
        0.005,
        "s",
        "Shortest bit of a random binary sequence; five samples where they are further apart than a millisecond.",
        "suite 'ties' (0762a7f)",
    )
    independent: float = number(
        0.1,
        "1",
        "Share of the samples that counts: noise is not white, and no law is exact.",
        "suite 'ties' (0762a7f)",
    )
    amplitudes: tuple[float, ...] = number(
        (0.25, 0.5, 0.75, 1.0),
        "1",
        "Amplitudes of a proposed sweep, as shares of the largest that was used.",
        "tables and recordings of others (59a88f6)",
    )
    enough: float = number(
        10.0,
        "log Bayes factor",
        "Two models count as separated for good.",
        "tables and recordings of others (59a88f6)",
    )
    separated: float = number(
        3.0,
        "log Bayes factor",
        "An experiment is said to separate two models.",
        "tables and recordings of others (59a88f6)",
    )
    frequencies: int = number(
        6,
        "frequencies",
        "Frequencies of a table at which an amplitude sweep is tried.",
        "tables and recordings of others (59a88f6)",
    )


NOISE = Noise()
FITTING = Fitting()
TABLES = Tables()
INTERVALS = Intervals()
COARSE = Coarse()
EVIDENCE = Evidence()
SEARCH = Search()
TONES = Tones()
RECOVERY = Recovery()
WORDING = Wording()
RECORDING_CHECKS = RecordingChecks()
NEXT_EXPERIMENT = NextExperiment()

GROUPS = (
    NOISE,
    FITTING,
    TABLES,
    INTERVALS,
    COARSE,
    EVIDENCE,
    SEARCH,
    TONES,
    RECOVERY,
    WORDING,
    RECORDING_CHECKS,
    NEXT_EXPERIMENT,
)
