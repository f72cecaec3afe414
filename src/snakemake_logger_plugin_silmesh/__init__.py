"""Writes what Snakemake does as lines of JSON, beside its text: ``snakemake --logger silmesh``.

Snakemake finds it by its name. Each line is an object with an ``event`` and the fields of it that
``FIELDS`` names, as Snakemake's logger plugins know them.
"""

import json
import os
from dataclasses import dataclass, field
from logging import Handler, LogRecord

from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent
from snakemake_interface_logger_plugins.settings import LogHandlerSettingsBase

FIELDS = {
    LogEvent.RUN_INFO: ("stats",),  # how many jobs of each rule there are, and their "total"
    LogEvent.JOB_INFO: ("jobid", "rule_name", "rule_msg", "wildcards"),  # a job begins
    LogEvent.JOB_FINISHED: ("job_id",),
    LogEvent.JOB_ERROR: ("jobid", "rule_name", "log"),  # its log files, a list
    LogEvent.PROGRESS: ("done", "total"),
}


@dataclass
class LogHandlerSettings(LogHandlerSettingsBase):
    """Where the lines go."""

    file: int = field(
        default=1,
        metadata={"help": "Number of the open file that lines of JSON go to.", "type": int},
    )


class LogHandler(LogHandlerBase):
    """Writes the events of ``FIELDS``; Snakemake's own text stays as it is."""

    def __post_init__(self) -> None:
        Handler.__init__(self)  # version 1 of the interface leaves it out

    def emit(self, record: LogRecord) -> None:
        """Write a line, if the event is one of ours."""
        event = getattr(record, "event", None)
        if event not in FIELDS:
            return
        fields = {name: getattr(record, name, None) for name in FIELDS[event]}
        try:
            line = json.dumps({"event": str(event), **fields}, default=str)
            os.write(self.settings.file, f"{line}\n".encode())
        except Exception:  # one that gets out ends the thread that logs
            self.handleError(record)

    @property
    def writes_to_stream(self) -> bool:
        """No: a plugin that does takes the place of Snakemake's text."""
        return False

    @property
    def writes_to_file(self) -> bool:
        """No: Snakemake tells the user of such a file."""
        return False

    @property
    def has_filter(self) -> bool:
        """Yes: --quiet is for the text."""
        return True

    @property
    def has_formatter(self) -> bool:
        """Yes: JSON."""
        return True

    @property
    def needs_rulegraph(self) -> bool:
        """No."""
        return False
