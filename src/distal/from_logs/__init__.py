"""A rig from logs: columns, structure and sizes."""

from distal.from_logs.column_values import ColumnRole
from distal.from_logs.draft_columns import DraftColumns, draft_columns
from distal.from_logs.rig_from_logs import RigFromLogs, rig_from_logs

__all__ = ["ColumnRole", "DraftColumns", "RigFromLogs", "draft_columns", "rig_from_logs"]
