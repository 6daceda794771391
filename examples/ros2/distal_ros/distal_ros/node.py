"""A ROS 2 node: joint states of the motors in, the joint's state and its band out.

Subscribes to `motor_states` (sensor_msgs/JointState): position is what the rig's position sensor of that drive reads,
effort what its force sensor reads, in the units of the rig's sensors. Publishes `joint_estimate` (sensor_msgs/JointState:
position and, as effort, the standard deviation [rad]) and `joint_health` (diagnostic_msgs/DiagnosticStatus).
"""

import math

import rclpy
import rclpy.executors
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.node import Node
from sensor_msgs.msg import JointState

import distal
from distal.rig import log_factor
from distal.run import HEALTH

LEVELS = {
    "ok": DiagnosticStatus.OK,
    "untested": DiagnosticStatus.OK,
    "missing": DiagnosticStatus.WARN,
    "gap": DiagnosticStatus.WARN,
}


class EstimateNode(Node):
    """Runs one `LiveEstimator`."""

    def __init__(self):
        super().__init__("distal")
        name = self.declare_parameter("rig", "capstan-joint").value
        self._rig = distal.load_rig(name)
        # each drive is a joint of the message; with one drive its name may be given
        motor = self.declare_parameter("motor", "").value
        drives = [drive.name for drive in self._rig.drives]
        if motor and len(drives) > 1:
            raise ValueError(f"'motor' renames a single drive, this rig has {drives}: name the message's joints so")
        self._named = {motor: drives[0]} if motor else {drive: drive for drive in drives}
        self._warned = False
        estimator = self.declare_parameter("estimator", "adaptive").value
        self._live = distal.LiveEstimator(self._rig, estimator)
        self._monitor = distal.Monitor(self._live)
        sensors = {sensor.name: sensor for sensor in self._rig.sensors}
        self._sensors = [sensors[channel] for channel in self._live.channels]
        self._estimate = self.create_publisher(JointState, "joint_estimate", 10)
        self._health = self.create_publisher(DiagnosticStatus, "joint_health", 10)
        self.create_subscription(JointState, "motor_states", self._take, 50)
        self.get_logger().info(f"{self._rig.name}: {estimator}, reads {', '.join(self._live.channels)}")

    def _take(self, message):
        if not self._warned and not set(self._named) <= set(message.name):
            self._warned = True
            self.get_logger().warning(f"{list(self._named)} expected in one message, {list(message.name)} came")
        stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        reading = self._monitor.take(stamp, self._sample(message))
        if math.isfinite(reading.angle):
            made = JointState()
            made.header.stamp = message.header.stamp
            made.name = [self._rig.joints[0].name]
            made.position = [reading.angle]
            made.effort = [reading.angle_std]
            self._estimate.publish(made)
        status = DiagnosticStatus()
        status.level = LEVELS.get(reading.health, DiagnosticStatus.ERROR)
        status.name, status.message = f"distal: {self._rig.joints[0].name}", reading.health
        status.values = [
            KeyValue(key="meaning", value=HEALTH[reading.health]),
            KeyValue(key="detail", value=reading.detail),
        ]
        self._health.publish(status)

    def _sample(self, message):
        """Return the values of the estimator's channels, SI, NaN where the message lacks one."""
        import numpy as np

        sample = np.full(len(self._sensors), np.nan)
        for i, name in enumerate(message.name):
            drive = self._named.get(name)
            for k, sensor in enumerate(self._sensors):
                values = {"position": message.position, "force": message.effort}.get(sensor.measures, ())
                if sensor.of == drive and i < len(values):
                    sample[k] = sensor.sign * log_factor(sensor) * values[i]
        return sample


def main():
    rclpy.init()
    node = EstimateNode()
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        pass
    finally:
        node.destroy_node()


if __name__ == "__main__":
    main()
