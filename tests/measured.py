"""The measured logs that are shipped with the project, for tests."""

from pathlib import Path

LOGS = Path(__file__).parents[1] / "models" / "logs"
