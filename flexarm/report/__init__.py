"""Reports: a diagnosis, a fit, a comparison, recordings or a simulation as one HTML page that works offline."""

from flexarm.report.comparison_page import write_comparisons
from flexarm.report.diagnosis_page import write_diagnosis
from flexarm.report.fit_page import write_fit
from flexarm.report.plan_page import write_plan
from flexarm.report.recordings_page import write_recordings
from flexarm.report.run_page import write_run

__all__ = ["write_comparisons", "write_diagnosis", "write_fit", "write_plan", "write_recordings", "write_run"]
