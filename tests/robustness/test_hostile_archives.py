"""FMU and SSP files that mean harm: each is refused with its reason, in bounded time and memory; nothing escapes."""

from __future__ import annotations

import io
import resource
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from engine.errors import FlexarmError
from flexarm.cosim import run
from fmu import archive
from scenarios.load import load
from tests.robustness.archives import DESCRIPTION, HOST, SSD, check_archive, fmu, packed, ssp
from tests.robustness.guard import RESULT, bounded

Use = Callable[[bytes, Path], object]


def as_fmu(content: bytes, folder: Path) -> object:
    (folder / "plant.fmu").write_bytes(content)
    return run(folder / "plant.fmu", stop=0.003, step=0.001)


def as_block(content: bytes, folder: Path) -> object:
    from flexarm.api import simulate

    (folder / "plant.fmu").write_bytes(content)
    (folder / "host.yaml").write_text(HOST)
    return simulate(load(folder / "host.yaml"), backend="interpreter")


def as_ssp(content: bytes, folder: Path) -> object:
    (folder / "x.ssp").write_bytes(content)
    return run(folder / "x.ssp", stop=0.003, step=0.001)


def inside_ssp(content: bytes, folder: Path) -> object:
    """An FMU inside of a package that is itself sound."""
    return as_ssp(packed(ssp() | {"resources/plant.fmu": content}), folder)


FMU_WAYS = [as_fmu, as_block, inside_ssp]


def refused(use: Use, content: bytes, folder: Path, message: str) -> FlexarmError:
    """Assert that a use is refused within seconds of work, and that nothing is left or written outside."""
    (folder / "outer").mkdir()
    (folder / "outer" / "inner").mkdir()
    with bounded(20), pytest.raises(FlexarmError, match=message) as caught:
        use(content, folder / "outer" / "inner")
    assert [path.name for path in (folder / "outer").iterdir()] == ["inner"]
    return caught.value


@pytest.mark.parametrize("kind", ["fmu", "ssp", "block"])
def test_the_sound_files_run(kind: str) -> None:
    """What the others are changed from is accepted, so that they are refused for their change."""
    assert check_archive((kind, packed(ssp() if kind == "ssp" else fmu()))) == RESULT


@pytest.mark.parametrize("use", [*FMU_WAYS, as_ssp])
@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("../escaped", "leads out of the archive"),
        ("resources/../../escaped", "leads out of the archive"),
        ("..", "leads out of the archive"),
        ("/tmp/escaped", "is an absolute path"),
        ("..\\escaped", "has a character that no portable path holds"),
        ("C:/escaped", "has a character that no portable path holds"),
    ],
)
def test_paths_that_lead_out(use: Use, name: str, reason: str, tmp_path: Path) -> None:
    files = ssp() if use is as_ssp else fmu()
    refused(use, packed(files | {name: b"escaped"}), tmp_path, reason)


@pytest.mark.parametrize("use", [*FMU_WAYS, as_ssp])
def test_links(use: Use, tmp_path: Path) -> None:
    files = ssp() if use is as_ssp else fmu()
    content = packed(files | {"resources/link": b"/etc/passwd"}, {"resources/link": 0o120777})
    refused(use, content, tmp_path, "'resources/link' is a link or another special file")


@pytest.mark.parametrize("use", [*FMU_WAYS, as_ssp])
def test_two_entries_of_one_name(use: Use, tmp_path: Path) -> None:
    """The second could be unpacked over the first, which had been looked at."""
    files = ssp() if use is as_ssp else fmu()
    content = io.BytesIO(packed(files))
    with pytest.warns(UserWarning, match="Duplicate name"), zipfile.ZipFile(content, "a") as made:
        made.writestr(next(iter(files)), b"another")
    refused(use, content.getvalue(), tmp_path, "is there twice")


@pytest.mark.parametrize("use", [as_fmu, as_block, as_ssp])
def test_a_bomb_of_one_file(use: Use, tmp_path: Path) -> None:
    """1 GB of zeros in 1 MB."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as made:
        for name, data in (ssp() if use is as_ssp else fmu()).items():
            made.writestr(name, data)
        with made.open("resources/zeros", "w", force_zip64=True) as entry:
            block = bytes(1 << 20)
            for _ in range(1000):
                entry.write(block)
    assert len(content.getvalue()) < 2_000_000
    refused(use, content.getvalue(), tmp_path, r"would unpack to 10\d\d MB; at most \d+ MB are unpacked")


@pytest.mark.parametrize("use", [as_fmu, as_block, as_ssp])
def test_a_bomb_of_many_entries_on_one_body(use: Use, tmp_path: Path) -> None:
    """5000 entries of the directory that all point to the same 1 MB: 5 GB of a file of 400 kB."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as made:
        for name, data in (ssp() if use is as_ssp else fmu()).items():
            made.writestr(name, data)
        made.writestr("resources/body", bytes(1 << 20))
        body = made.getinfo("resources/body")
        for k in range(5000):
            copy = zipfile.ZipInfo(f"resources/{k}")
            for key in ("compress_type", "file_size", "compress_size", "CRC", "header_offset", "flag_bits"):
                setattr(copy, key, getattr(body, key))
            made.filelist.append(copy)
            made.NameToInfo[copy.filename] = copy
    refused(use, content.getvalue(), tmp_path, r"would unpack to 5\d\d\d MB")


def test_an_archive_of_very_many_files(tmp_path: Path) -> None:
    content = packed(fmu() | {f"resources/{k}": b"" for k in range(archive.MOST_FILES + 1)})
    refused(as_fmu, content, tmp_path, r"holds \d+ files; at most 20000")


LAUGHS = b"<!DOCTYPE x [<!ENTITY a0 'ha'>%s]>" % b"".join(
    b"<!ENTITY a%d '%s'>" % (k, b"&a%d;" % (k - 1) * 10) for k in range(1, 12)
)


@pytest.mark.parametrize("use", [*FMU_WAYS, as_ssp])
@pytest.mark.parametrize(
    ("doctype", "text"),
    [
        (LAUGHS, b"&a11;"),
        (b"<!DOCTYPE x [<!ENTITY e SYSTEM 'file:///etc/passwd'>]>", b"&e;"),
        (b"<!DOCTYPE x [<!ENTITY %% p SYSTEM 'http://127.0.0.1:9/x.dtd'> %%p;]>".replace(b"%%", b"%"), b"x"),
        (b"<!DOCTYPE x SYSTEM 'http://127.0.0.1:9/x.dtd'>", b"x"),
        (b"<!DOCTYPE x [<!ENTITY q '" + b"q" * 100_000 + b"'>]>", b"&q;" * 10_000),
    ],
    ids=["laughs", "file", "parameter entity", "remote", "quadratic"],
)
def test_entities(use: Use, doctype: bytes, text: bytes, tmp_path: Path) -> None:
    """A document type is refused before an entity is expanded, a file read or an address asked."""
    files = dict(ssp() if use is as_ssp else fmu())
    name = SSD if use is as_ssp else DESCRIPTION
    head, mark, rest = files[name].partition(b"?>")
    files[name] = head + mark + doctype + rest.replace(b'name="', b'name="' + text, 1)
    error = refused(use, packed(files), tmp_path, "it declares a document type")
    assert "root:" not in str(error)


@pytest.mark.parametrize("use", [as_fmu, as_block, as_ssp])
@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"<a>" * 200_000, "nested more than 100 levels deep"),
        (b"<a>" + b"<b/>" * 1_100_000 + b"</a>", "more than 1000000 elements"),
        (b"<a>" + b" " * 70_000_000 + b"</a>", "MB; at most 64 MB are read"),
        (b"\xff\xfe<\0a\0/\0", "is not XML"),
        (b"<?xml version='1.0' encoding='utf-7'?><a/>", "is not XML"),
        (b"", "is not XML"),
    ],
    ids=["deep", "many", "large", "half a character", "odd encoding", "empty"],
)
def test_xml_out_of_proportion(use: Use, content: bytes, message: str, tmp_path: Path) -> None:
    files = ssp() if use is as_ssp else fmu()
    refused(use, packed(files | {SSD if use is as_ssp else DESCRIPTION: content}), tmp_path, message)


@pytest.mark.parametrize("source", ["../outside.fmu", "/tmp/outside.fmu", "resources/../../outside.fmu"])
def test_a_component_outside_of_the_package(source: str, tmp_path: Path) -> None:
    """Even where such a file exists and is sound."""
    files = dict(ssp())
    files[SSD] = files[SSD].replace(b'source="resources/plant.fmu"', f'source="{source}"'.encode())
    (tmp_path / "outside.fmu").write_bytes(packed(fmu()))
    refused(as_ssp, packed(files), tmp_path, "component 'plant' lies outside of the package")


def test_a_binary_outside_of_the_fmu(tmp_path: Path) -> None:
    """The model identifier names the library to load."""
    files = dict(fmu())
    files[DESCRIPTION] = files[DESCRIPTION].replace(b'modelIdentifier="', b'modelIdentifier="../../../outer/')
    for use in (as_fmu,):
        refused(use, packed(files), tmp_path, "is not a C identifier")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b'stopTime="0.003"', b'stopTime="soon"', "its stopTime is 'soon'"),
        (b'stopTime="0.003"', b'stopTime="inf"', "its stopTime is 'inf'"),
        (b'seconds="0.001"', b'seconds="0"', "its seconds is '0'"),
        (b'startElement="plant"', b'startElement="plan"', "connects the component 'plan'"),
        (b'endElement="plant"', b"", "connects the connector 'motor_voltage' of the system"),
        (b'name="motor_shaft_speed" kind="output"', b'name="motor_voltage" kind="output"', "has two connectors"),
        (b"</ssd:Elements>", b'<ssd:Component name="plant"/></ssd:Elements>', "has two components 'plant'"),
        (b'endConnector="motor_shaft_speed"', b'endConnector="nothing"', "connects the connector 'nothing'"),
    ],
)
def test_structures_that_cannot_run(old: bytes, new: bytes, message: str, tmp_path: Path) -> None:
    files = dict(ssp())
    assert old in files[SSD]
    files[SSD] = files[SSD].replace(old, new)
    refused(as_ssp, packed(files), tmp_path, message)


def test_two_variables_of_one_name(tmp_path: Path) -> None:
    files = dict(fmu())
    files[DESCRIPTION] = files[DESCRIPTION].replace(b'name="motor.shaft.angle"', b'name="motor_voltage"')
    assert files[DESCRIPTION] != fmu()[DESCRIPTION]
    refused(as_fmu, packed(files), tmp_path, "it has two variables 'motor_voltage'")


def test_encrypted_entries(tmp_path: Path) -> None:
    """The flag in the directory at the end of the archive."""
    content = bytearray(packed(fmu()))
    content[content.rindex(b"PK\x01\x02") + 8] |= 1
    refused(as_fmu, bytes(content), tmp_path, "is encrypted")


def test_too_many_communication_steps(tmp_path: Path) -> None:
    (tmp_path / "plant.fmu").write_bytes(packed(fmu()))
    with bounded(20), pytest.raises(FlexarmError, match="1e\\+10 s in communication steps of 1e-06 s"):
        run(tmp_path / "plant.fmu", stop=1e10, step=1e-6)


@pytest.mark.parametrize("ending", ["fmu", "ssp"])
def test_memory_stays_bounded(ending: str, tmp_path: Path) -> None:
    """The command refuses 1 GB of zeros with 1 GB of address space, on stderr and without a traceback."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as made:
        name = SSD if ending == "ssp" else DESCRIPTION
        with made.open(name, "w", force_zip64=True) as entry:
            entry.write(b"<a>")
            for _ in range(1000):
                entry.write(b" " * (1 << 20))
    (tmp_path / f"x.{ending}").write_bytes(content.getvalue())
    done = subprocess.run(
        [sys.executable, "-m", "flexarm", "cosim", f"x.{ending}"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (1 << 30, 1 << 30)),
        env={"PYTHONPATH": str(Path(__file__).parents[2]), "OPENBLAS_NUM_THREADS": "1", "PATH": "/usr/bin:/bin"},
    )
    assert done.returncode == 1
    assert "would unpack to" in done.stderr
    assert "Traceback" not in done.stderr
