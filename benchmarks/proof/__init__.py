"""The proof: effects concealed by `benchmarks.concealed`, diagnosed blind, and scored.

Each case runs in a folder that holds the scenario and the recordings only; its answer lies in another folder that only
the scorer opens. Run ``python -m benchmarks.proof --help``.
"""
