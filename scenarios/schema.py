"""The fixed structure of a scenario file, as pydantic models. Blocks' own parameters are checked by the blocks.

A value is a number in the unit the place expects, a text with a unit such as ``7.68 mN.m/A``, ``$name`` for one of the
scenario's parameters, or an expression of them such as ``$mass * $radius^2`` (`scenarios.expressions`).
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Discriminator, Field, Tag, WithJsonSchema
from pydantic_core import PydanticCustomError

SECTIONS = (
    "schema",
    "name",
    "description",
    "parameters",
    "blocks",
    "connect",
    "expose",
    "initial",
    "tolerances",
    "simulate",
    "analyses",
    "recordings",
)

EXPRESSION_PATTERN = r"[^$]*\$[A-Za-z_]\w*.*|\s*=.+"
QUANTITY_PATTERN = (
    r"^(\s*([-+]?([0-9][0-9_]*\.?[0-9_]*|\.[0-9]+)([eE][-+]?[0-9]+)?\s*[A-Za-z0-9./%*^()_ µΩ°-]*)\s*|"
    rf"{EXPRESSION_PATTERN})$"
)
FILE = (
    "a .csv, .mat, .parquet, .json, .jsonl or .dat file, or with extras .mcap, a rosbag2, .h5, .mf4, .tdms or .xlsx; "
    "relative to this file, or $FLEXARM_RECORDINGS/... for one in the folder that this environment variable names"
)
SIGNED_NUMBERS = ("int8", "int16", "int32")
"""Words of ``wrap:`` for signed numbers that were stored without their sign."""
LONGEST_NAME = 100
"""Characters of a name; names of files, of C functions and of variables are made of it."""
NAME_PATTERN = r"^[A-Za-z_][A-Za-z0-9_]*$"
ASSEMBLY_PATTERN = r"\.ya?ml$"


def _quantity(value: object) -> object:
    if value is None:
        raise PydanticCustomError("quantity", "no value is given; write a number or a text with a unit")
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise PydanticCustomError("quantity", "a number or a text with a unit is expected")
    return value


def _name(value: str) -> str:
    if not value.isascii() or not value.isidentifier() or value in SECTIONS:
        raise PydanticCustomError("name", "a name is made of letters, digits and _, and is not the name of a section")
    if len(value) > LONGEST_NAME:
        raise PydanticCustomError("name", f"a name has at most {LONGEST_NAME} characters")
    return value


def _title(value: object) -> object:
    # Names of files, figures and C functions are made of it.
    if isinstance(value, str) and (len(value) > LONGEST_NAME or len(value.splitlines()) > 1):
        raise PydanticCustomError(
            "title", f"a short name of one line, of at most {LONGEST_NAME} characters, is expected"
        )
    return _text(value)


def _text(value: object) -> object:
    if not isinstance(value, str):
        raise PydanticCustomError("text", "a text is expected; put quotes around it if it looks like a number")
    return value


Quantity = Annotated[
    Any,
    BeforeValidator(_quantity),
    WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "string", "pattern": QUANTITY_PATTERN}]}),
]
AutoQuantity = Annotated[
    Any,
    BeforeValidator(_quantity),
    WithJsonSchema({"anyOf": [{"type": "number"}, {"const": "auto"}, {"type": "string", "pattern": QUANTITY_PATTERN}]}),
]
Wrap = Annotated[
    Any,
    BeforeValidator(lambda value: value if isinstance(value, bool) else _quantity(value)),
    WithJsonSchema(
        {
            "anyOf": [
                {"type": "boolean"},
                {"type": "number"},
                {"enum": list(SIGNED_NUMBERS)},
                {"type": "string", "pattern": QUANTITY_PATTERN},
            ]
        }
    ),
]
Text = Annotated[str, BeforeValidator(_text)]
Title = Annotated[str, BeforeValidator(_title), Field(json_schema_extra={"maxLength": LONGEST_NAME})]
Name = Annotated[str, AfterValidator(_name), Field(json_schema_extra={"pattern": NAME_PATTERN})]
Endpoint = Annotated[Text, Field(description="block.port, for example motor.shaft")]


class Section(BaseModel):
    """Common settings: unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=False, protected_namespaces=())


class BlockEntry(BaseModel):
    """A block, or a sub-assembly when the type is a YAML file."""

    model_config = ConfigDict(extra="allow", frozen=True)
    type: Text = Field(description="name of a block, or a path such as ./arm.yaml")


class Simulate(Section):
    """How `flexarm run` simulates."""

    stop: Quantity = Field(description="end of the simulation, s")
    step: Quantity = Field(default=1e-3, description="interval between recorded points, s")
    internal_step: Quantity | None = Field(
        default=None,
        description="longest step of the integration, s; if absent, chosen from the fastest mode and the lasting ones",
    )
    step_tolerance: Quantity | None = Field(
        default=None,
        description="repeat with half the internal step; warn if an output changes by more of its range than this",
    )
    record: list[Text] | None = Field(default=None, min_length=1, description="signals to record; all if absent")


class Analysis(Section):
    """Fields that linearise and export share."""

    inputs: list[Endpoint] = Field(description="signal inputs; each replaces the connection that fed it", min_length=1)
    outputs: list[Text] = Field(description="signals given out", min_length=1)


class PointAnalysis(Analysis):
    """Fields of analyses at an operating point."""

    modes: dict[str, int | str] = Field(
        default_factory=dict, description="for each friction or contact: -1, 0, +1, or its label"
    )
    at: dict[str, Quantity] = Field(
        default_factory=dict, description="operating point: values of states and inputs; rest if absent"
    )


class Trim(PointAnalysis):
    """An equilibrium; ``at`` is where the search begins."""

    kind: Literal["trim"] = Field(description="an equilibrium")
    fix: dict[str, Quantity] = Field(
        default_factory=dict, description="values that motions, states, inputs or outputs must have"
    )
    free: list[Endpoint] = Field(default_factory=list, description="inputs that are searched for; the others are given")
    bounds: dict[str, Annotated[list[Quantity], Field(min_length=2, max_length=2)]] = Field(
        default_factory=dict, description="least and greatest value of a state or a free input"
    )


class Family(PointAnalysis):
    """Fields of analyses that take a family of linear models."""

    trim: Text | None = Field(default=None, description="an analysis of kind trim, whose equilibrium is the point")
    grid: dict[str, Text] = Field(
        default_factory=dict,
        description="scheduling variables, parameters, states, motions or inputs: START:STOP:N or A,B,C, with units",
    )


class Linearise(Family):
    """A linear model about an operating point, or a family of them."""

    kind: Literal["linearise"] = Field(description="a linear model")
    snapshots: Quantity | None = Field(
        default=None, description="a linear model at every mode change of the simulation, and at this interval, s"
    )
    every_mode: bool = Field(default=False, description="a linear model in every combination of modes that can occur")


class Describe(PointAnalysis):
    """What sines of several amplitudes meet: describing functions with their harmonics."""

    kind: Literal["describe"] = Field(description="frequency responses by amplitude")
    amplitudes: list[Quantity] = Field(min_length=1, description="amplitudes of the sine on the one input")
    frequencies: Text = Field(description="START:STOP:N:log or A,B,C, with Hz or rad/s")
    harmonics: int = Field(default=5, ge=1, le=50, description="highest harmonic that is given")


class Margins(Family):
    """Margins of a loop, opened at the one input; ``outputs`` is the signal that comes back."""

    kind: Literal["margins"] = Field(description="margins of a loop")
    outputs: list[Text] = Field(
        default_factory=list,
        description="the signal that comes back to the input; what feeds it if absent",
        max_length=1,
    )


class Uncertain(Family):
    """A family of linear models from what recordings say of the parameters."""

    kind: Literal["uncertain"] = Field(description="a family from the covariance of a fit")
    recordings: list[Text] = Field(default_factory=list, description="to fit to; all but those held out if absent")
    hold_out: list[Text] = Field(default_factory=list, description="to judge on, beside those of that role")
    samples: int = Field(default=50, ge=1, le=100_000, description="members of the family")
    seed: int = Field(default=0, ge=0, description="of the samples")


class Export(Analysis):
    """An FMU."""

    kind: Literal["export"] = Field(description="an FMU")


class TimeColumn(Section):
    """The time axis of a recording: a column, or the interval between samples where the file has none."""

    column: Text | None = Field(default=None, description="name of the column that holds the time")
    unit: Text = Field(default="s", description="unit of the numbers in the column")
    interval: Quantity | None = Field(default=None, description="time between samples, s, in place of a column")
    clock: Literal["as_logged", "even", "either"] = Field(
        default="either",
        description="even: samples were taken evenly, and the column strays about it; either: whichever a fit follows",
    )


class Drive(Section):
    """A recorded signal that drives an input of the model."""

    column: Text = Field(description="name of the column")
    unit: Text = Field(description="unit of the numbers in the column")
    scale: Quantity = Field(default=1.0, description="what a number is multiplied by; its unit changes the column's")
    sign: Literal[-1, 1] = Field(default=1, description="-1 where the recorded signal counts the other way")
    tap: Text = Field(
        default="after_limit", description="where the signal was logged: after_limit or before_limit of the amplifier"
    )
    hold: Literal["zero_order", "linear", "band_limited"] | None = Field(
        default=None,
        description="what happens between samples; band_limited: nothing above half the sampling frequency was sent. "
        "zero_order if not given, unless a fit follows a straight line better",
    )
    offset: Quantity = Field(default=0.0, description="what the column shows at zero, in its unit; it is taken away")
    enable: Text | None = Field(
        default=None, description="column that says when the source acts; where it holds 0, the input is 0"
    )
    zero: Literal["first", "none"] = Field(default="none", description="first: count from the first sample")
    wrap: Wrap = Field(default=False, description="as that of a measurement")


class Measurement(Section):
    """A recorded signal to compare with a signal of the model."""

    column: Text = Field(description="name of the column")
    unit: Text = Field(description="unit of the numbers in the column; 'count' for an encoder")
    scale: Quantity = Field(default=1.0, description="what a number is multiplied by; its unit changes the column's")
    sign: Literal[-1, 1] = Field(default=1, description="-1 where the recorded signal counts the other way")
    zero: Literal["first", "none"] = Field(default="none", description="first: count from the first sample")
    offset: Quantity = Field(default=0.0, description="what the column shows at zero, in its unit; it is taken away")
    wrap: Wrap = Field(
        default=False,
        description="true: the recorded angle jumps at each revolution and is made continuous; or the range after "
        "which the column begins anew, in its unit, such as 65536; int8, int16 or int32: signed numbers of so many "
        "bits that were read without their sign, -1 as 65535",
    )
    counts_per_rev: Quantity | None = Field(default=None, description="encoder counts in a revolution")
    noise: Quantity = Field(default="auto", description="standard deviation in the column's unit, or auto")
    use: Literal["fit", "evidence"] = Field(
        default="fit",
        description="evidence: a spare column, such as a motor's current. Nothing is fitted to it; where a diagnosis "
        "cannot tell effects apart it says which of them predicts it, whatever its gain and offset",
    )


class StartOfRecord(Section):
    """The state in which a recording begins."""

    state: Literal["at_rest", "as_measured"] = Field(
        default="at_rest",
        description="at_rest: where the model begins, nothing moves; as_measured: what is measured begins at its first "
        "samples, the rest in equilibrium with it, and a fit may move the former within the noise",
    )
    free: list[Text] = Field(default_factory=list, description="states that a fit may choose for this recording")
    values: dict[str, Quantity] = Field(
        default_factory=dict,
        description="starting values that are known, for example link.hub.angle; one that is free as well begins there",
    )


class Alike(Section):
    """A column of a further file, and one of the leading file, that show the same motion."""

    column: Text = Field(description="name of the column in the further file")
    to: Text = Field(description="name of the column in the leading file")


class FurtherFile(Section):
    """Another file of the same experiment, with a clock of its own."""

    file: Text = Field(description=FILE)
    format: Text | None = Field(default=None, description="of a file whose ending does not tell it, such as csv")
    name: Name | None = Field(
        default=None, description="its columns are then called name.column; needed where two files have one of a name"
    )
    time: TimeColumn = Field(description="its time axis")
    offset: AutoQuantity = Field(
        default=0.0, description="added to its time to get that of the leading file, s, or auto: found by `alike`"
    )
    rate: AutoQuantity = Field(
        default=1.0, description="seconds of the leading file's clock to one of its own, or auto: found by `alike`"
    )
    alike: Alike | None = Field(default=None, description="columns by which an offset or a rate is found")


class TimeRecording(Section):
    """A recording over time."""

    kind: Literal["time_series"] = Field(default="time_series", description="a recording over time")
    file: Text = Field(description=FILE)
    format: Text | None = Field(default=None, description="of a file whose ending does not tell it, such as csv")
    time: TimeColumn = Field(description="the time axis")
    files: list[FurtherFile] = Field(
        default_factory=list, description="further files of the experiment; `file` leads: its time is the recording's"
    )
    window: list[Quantity] | None = Field(
        default=None,
        description="first and last instant to use, s, as the file counts time",
        min_length=2,
        max_length=2,
    )
    resample: Quantity | None = Field(
        default=None,
        description="compare at this interval, s; the drive keeps every sample, and nothing is filtered",
    )
    drive: dict[str, Drive] = Field(default_factory=dict, description="input of the model: recorded column")
    measurements: dict[str, Measurement] = Field(description="signal of the model: recorded column", min_length=1)
    lead_in: int = Field(
        default=0,
        description="periods of the drive to be simulated beforehand, for a recording that is one whole period",
        ge=0,
        le=1000,
    )
    gaps: Literal["refuse", "skip"] = Field(
        default="refuse",
        description="what to do with rows in which time or drive holds no number; a measurement is not compared there",
    )
    initial: StartOfRecord = Field(default=StartOfRecord(), description="the state in which the recording begins")
    set: dict[str, Quantity] = Field(
        default_factory=dict,
        description="values of parameters that hold for this recording alone, for example pid.proportional_gain",
    )
    loop: Literal["open", "closed", "reference"] = Field(
        default="open",
        description="closed: recorded under control, the drive is the plant's input; reference: the drive is what the "
        "scenario's controller is to follow",
    )
    sampled: Literal["before_input", "after_input", "either"] = Field(
        default="either",
        description="before_input: a row's measurements were taken before its input acts, as by a controller that "
        "reads first; either: whichever a fit follows, after_input elsewhere",
    )
    role: Literal["train", "hold_out", "repeat"] = Field(
        default="train", description="train: fitted; hold_out: judged on alone; repeat: the same experiment again"
    )


class Frequency(Section):
    """The frequency column of a table."""

    column: Text = Field(description="name of the column")
    unit: Text = Field(description="Hz or rad/s")


class Amplitude(Section):
    """The amplitude of the sine that drives the model: a column, or one value for all rows."""

    column: Text | None = Field(default=None, description="name of the column")
    value: Quantity | None = Field(default=None, description="one amplitude for all rows, in place of a column")
    unit: Text = Field(default="", description="unit of the numbers in the column")


class Response(Section):
    """A measured amplitude."""

    column: Text = Field(description="name of the column")
    unit: Text = Field(description="unit of the numbers in the column")
    scale: Quantity = Field(default=1.0, description="what a number is multiplied by; its unit changes the column's")
    reading: Literal["half_peak_to_peak"] = Field(
        default="half_peak_to_peak", description="how the amplitude is read from the simulated response"
    )
    noise: Quantity = Field(default="auto", description="standard deviation in the column's unit, or auto")


class FrequencyRecording(Section):
    """A frequency-response table: one row per sine."""

    kind: Literal["frequency_response"] = Field(description="a frequency-response table")
    file: Text = Field(description=FILE)
    format: Text | None = Field(default=None, description="of a file whose ending does not tell it, such as csv")
    drive: Endpoint = Field(description="the input that the sine drives")
    frequency: Frequency = Field(description="the frequency of each row")
    amplitude: Amplitude = Field(description="the amplitude of the sine that drives the model")
    response: dict[str, Response] = Field(min_length=1, description="signal of the model: recorded column")
    internal_step: Quantity | None = Field(default=None, description="largest step of the integration, s")
    role: Literal["train", "hold_out", "repeat"] = Field(
        default="train", description="train: fitted; hold_out: judged on alone; repeat: the same experiment again"
    )


def _recording_kind(value: Any) -> str:
    kind = value.get("kind", "time_series") if isinstance(value, dict) else getattr(value, "kind", "time_series")
    return str(kind)


AnyAnalysis = Annotated[Linearise | Export | Trim | Describe | Margins | Uncertain, Field(discriminator="kind")]
AnyRecording = Annotated[
    Annotated[TimeRecording, Tag("time_series")] | Annotated[FrequencyRecording, Tag("frequency_response")],
    Discriminator(_recording_kind),
]


class ScenarioFile(Section):
    """A scenario, or a sub-assembly that another file takes in."""

    schema_: Literal[1] = Field(alias="schema", description="version of this format")
    name: Title = Field(description="short name")
    description: Text = Field(default="", description="one sentence")
    parameters: dict[Name, Quantity] = Field(default_factory=dict, description="values that blocks refer to as $name")
    blocks: dict[Name, BlockEntry] = Field(description="what there is", min_length=1)
    connect: list[Annotated[list[Endpoint], Field(min_length=2)]] = Field(
        default_factory=list, description="nodes: the ends that are joined"
    )
    expose: dict[Name, Endpoint] = Field(
        default_factory=dict, description="further names of inner ports, for the file that takes this one in"
    )
    initial: dict[str, Quantity] = Field(
        default_factory=dict, description="starting values, for example link.hub.angle"
    )
    tolerances: dict[str, Quantity] = Field(
        default_factory=dict,
        description="share by which a fit may move a parameter, or each value of a vector, in place of the library's "
        "tolerance; 0: it is known",
    )
    simulate: Simulate | None = Field(default=None, description="how `flexarm run` simulates")
    analyses: dict[Name, AnyAnalysis] = Field(
        default_factory=dict, description="linear models and FMUs to make: their inputs and outputs"
    )
    recordings: dict[Name, AnyRecording] = Field(
        default_factory=dict, description="measured data, and how they relate to the model"
    )
