"""A rig from logs: columns, structure and sizes."""

from distal.from_logs.column_names import ColumnRole
from distal.from_logs.rig_from_logs import DraftColumns, RigFromLogs, draft_columns, rig_from_logs

__all__ = ["ColumnRole", "DraftColumns", "RigFromLogs", "draft_columns", "rig_from_logs"]
