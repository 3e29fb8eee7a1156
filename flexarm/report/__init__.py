"""Reports: a diagnosis, recordings or a simulation as one HTML page that works offline."""

from flexarm.report.diagnosis_page import write_diagnosis
from flexarm.report.recordings_page import write_recordings
from flexarm.report.run_page import write_run

__all__ = ["write_diagnosis", "write_recordings", "write_run"]
