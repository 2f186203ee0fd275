"""What services log: a line for people, or one JSON object a line for machines."""

import json
import logging
import os

from sumo_dist.errors import unknown

VARIABLE = "SUMO_DIST_LOG"  # reaches every service of a run
FORMATS = ("text", "json")
TEXT = "%(name)s: %(message)s"


class JsonLines(logging.Formatter):
    """One object a record: when, who, how bad, what."""

    def format(self, record: logging.LogRecord) -> str:
        """Lay a record out."""
        line = {
            "time": round(record.created, 3),
            "pid": record.process,
            "source": record.name.removeprefix("sumo_dist."),
            "level": record.levelname.lower(),
            "text": record.getMessage(),
        }
        if record.exc_info:
            line["exception"] = self.formatException(record.exc_info)
        return json.dumps(line)


def configure() -> None:
    """Log to stderr in the format that the environment asks for.

    Raises:
        UsageError: it asks for one that there is not.
    """
    form = os.environ.get(VARIABLE, "text")
    if form not in FORMATS:
        raise unknown(f"{VARIABLE}", form, FORMATS)
    handler = logging.StreamHandler()
    handler.setFormatter(JsonLines() if form == "json" else logging.Formatter(TEXT))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
