"""Files of an uncertain model: JSON, MATLAB data, and a MATLAB script."""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from flexarm.design.uncertainty.results import UncertainModel


def write(made: UncertainModel, path: Path, name: str) -> list[Path]:
    """Write a family with its weights as .json or .mat, or as a MATLAB script with its MAT-file; returns the files.

    Raises:
        FlexarmError: an unknown kind of file, or it cannot be written.
    """
    from engine import family_files
    from engine.files import json_text, writing
    from engine.names import identifier

    plain = identifier(name)
    weights = {signal: (w.to_control(), w) for signal, w in made.weights.items()}

    def json() -> bytes:
        import json as reader

        rows = {
            signal: {"zeros": list(w.zeros), "poles": list(w.poles), "gain": w.gain}
            for signal, (_, w) in weights.items()
        }
        extra = {
            "weights": rows,
            "parameters": {"names": list(made.names), "covariance": made.covariance.tolist()},
            "samples": list(made.samples),
            "coverage": made.coverage if math.isfinite(made.coverage) else None,
        }
        return (json_text(reader.loads(family_files.as_json(made.family, name)) | extra, indent=1) + "\n").encode()

    def mat() -> bytes:
        from scipy.io import loadmat, savemat

        whole = {k: v for k, v in loadmat(io.BytesIO(family_files.as_mat(made.family))).items() if k[0] != "_"}
        whole["parameter_names"] = np.array(made.names, dtype=object)[:, None]
        whole["parameter_covariance"] = made.covariance
        whole["parameter_samples"] = np.array([[row.get(k, np.nan) for k in made.names] for row in made.samples])
        whole["weights"] = {
            identifier(signal): {"A": s.A, "B": s.B, "C": s.C, "D": s.D, "signal": signal}
            for signal, (s, _) in weights.items()
        }
        buffer = io.BytesIO()
        savemat(buffer, whole, long_field_names=True)
        return buffer.getvalue()

    def script(data: str) -> bytes:
        lines = [
            f"% {name}: uncertain model by flexarm. {plain}_nominal is the fitted model, {plain}_samples the draws",
            "% from its covariance; of each signal, measured = (1 + W * Delta) * predicted, Delta of gain 1 (ultidyn).",
            f"data = load('{data}');",
            f"{plain}_samples = ss(data.A, data.B, data.C, data.D);",
            f"{plain}_samples.SamplingGrid = data.sampling_grid;",
            f"{plain}_nominal = {plain}_samples(:, :, 1);",
            f"{plain}_parametric = ucover({plain}_samples(:, :, 2:end), {plain}_nominal, 2); % covers the draws",
        ]
        for signal in weights:
            field_name = identifier(signal)
            lines += [
                f"w = data.weights.{field_name};",
                f"W_{field_name} = ss(w.A, w.B, w.C, w.D);",
                f"U_{field_name} = 1 + W_{field_name} * ultidyn('Delta_{field_name}', [1 1]);",
            ]
        return ("\n".join(lines) + "\n").encode()

    kind = path.suffix.lower()
    files: dict[Path, Callable[[], bytes]] = {}
    if kind == ".m":
        files[path.with_suffix(".mat")] = mat
        files[path] = lambda: script(path.with_suffix(".mat").name)
    else:
        files[path] = {".json": json, ".mat": mat}.get(kind, json)
    for file, content in files.items():
        with writing(file, (".json", ".mat", ".m")) as temporary:
            temporary.write_bytes(content())
    return list(files)
