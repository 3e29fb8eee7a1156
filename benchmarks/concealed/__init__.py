"""Truth with something concealed: recordings for the proof, made by code that shares nothing with flexarm.

Nothing here imports engine, blocks, scenarios, fmu, diagnosis or flexarm, so that agreement with them is evidence. The
arm is a finite-element beam; the linear part is integrated exactly by the matrix exponential; dry friction is solved
as a set-valued law at every step of 20 us, contacts at 5 us; see simulator.c. Run
``python -m benchmarks.concealed list`` and ``python -m benchmarks.concealed make --help``.
"""

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # small matrices: threads of numerical libraries only get in the way
