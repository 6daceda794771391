"""A rig from logs: columns, structure and sizes.

In: logs with the joints' angles; out: which column is what, which drive moves which joint, and the
text of a rig file. A drive's displacement is regressed on the joints' angles, s = Σ r_j θ_j + c.

    from distal.from_logs.column_names import name_evidence

    for header in ("time_s", "motor_pos_deg", "joint_angle_deg"):
        print(name_evidence(header))
"""

from distal.from_logs.column_names import ColumnRole
from distal.from_logs.rig_from_logs import DraftColumns, RigFromLogs, draft_columns, rig_from_logs

__all__ = ["ColumnRole", "DraftColumns", "RigFromLogs", "draft_columns", "rig_from_logs"]
