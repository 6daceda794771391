"""A ROS 2 node: joint states of the motors in, all joints' angles out, with their standard deviations and health.

Subscribes to the topics of the parameter `topics` (sensor_msgs/JointState): position is what the rig's position sensor of a
drive reads, effort what its force sensor reads, in the units of the rig's sensors. Publishes `joint_estimate`
(sensor_msgs/JointState, position [rad] of all joints) and `joint_health` (diagnostic_msgs/DiagnosticArray, with the same
stamp: the word of `distal stream`, and the standard deviation of each joint's angle).
"""

import math

import numpy as np
import rclpy
import rclpy.executors
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
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
    "outside": DiagnosticStatus.WARN,
    "touched": DiagnosticStatus.OK,
}

TOGETHER = 0.5
"""Messages whose stamps are nearer than this share of the rig's interval are one sample."""


class EstimateNode(Node):
    """Runs one `LiveEstimator`."""

    def __init__(self):
        super().__init__("distal")
        self._rig = distal.load_rig(self.declare_parameter("rig", "capstan-joint").value)
        drives = [drive.name for drive in self._rig.drives]
        self._drives = drives_by_name(self.declare_parameter("names", [""]).value, drives)
        estimator = self.declare_parameter("estimator", "adaptive").value
        self._live = distal.LiveEstimator(self._rig, estimator)
        self._monitor = distal.Monitor(self._live)
        sensors = {sensor.name: sensor for sensor in self._rig.sensors}
        self._sensors = [sensors[channel] for channel in self._live.channels]
        self._desired = {
            k for k, sensor in enumerate(self._sensors) if sensor.measures in ("position", "force")
        }
        self._interval = 1.0 / max(sensor.rate for sensor in self._sensors)
        self._stamp, self._sample, self._came = None, self._empty(), set()
        self._warned = set()
        self._estimate = self.create_publisher(JointState, "joint_estimate", 10)
        self._health = self.create_publisher(DiagnosticArray, "joint_health", 10)
        topics = self.declare_parameter("topics", ["motor_states"]).value
        for topic in topics:
            self.create_subscription(JointState, topic, self._take, 50)
        reads = ", ".join(self._live.channels)
        self.get_logger().info(
            f"{self._rig.name}: {estimator}, reads {reads} from {', '.join(topics)}"
        )

    def _take(self, message):
        """Add a message to the sample of its stamp; estimate once all drives have come, or a later stamp has."""
        values = self._values(message)
        if (
            self._stamp is not None
            and abs(seconds(message.header.stamp) - seconds(self._stamp))
            > TOGETHER * self._interval
        ):
            self._step()
        if self._stamp is None:
            self._stamp = message.header.stamp
        for k, value in values.items():
            self._sample[k] = value
        self._came |= set(values)
        if self._came >= self._desired or not values:
            self._step()

    def _values(self, message):
        """Return what a message says: index of a channel → value, SI."""
        values, known = {}, False
        for i, name in enumerate(message.name):
            drive = self._drives.get(name)
            known = known or drive is not None
            for k, sensor in enumerate(self._sensors):
                said = {"position": message.position, "force": message.effort}.get(
                    sensor.measures, ()
                )
                if drive is not None and sensor.of == drive and i < len(said):
                    values[k] = sensor.sign * log_factor(sensor) * said[i]
        if not known and tuple(message.name) not in self._warned:
            self._warned.add(tuple(message.name))
            self.get_logger().warning(
                f"one of {list(self._drives)} expected in a message, {list(message.name)} came"
            )
        return values

    def _step(self):
        """Estimate with the sample that was collected, and publish."""
        stamp, sample = self._stamp, self._sample
        self._stamp, self._sample, self._came = None, self._empty(), set()
        reading = self._monitor.take(seconds(stamp), sample)
        joints = [joint.name for joint in self._rig.joints]
        if all(math.isfinite(angle) for angle in reading.angles):
            made = JointState()
            made.header.stamp = stamp
            made.name = joints
            made.position = [float(angle) for angle in reading.angles]
            self._estimate.publish(made)
        status = DiagnosticStatus()
        status.level = LEVELS.get(reading.health, DiagnosticStatus.ERROR)
        status.name, status.message, status.hardware_id = "distal", reading.health, self._rig.name
        said = {"meaning": HEALTH[reading.health], "detail": reading.detail}
        said |= {
            f"std of {name} [rad]": f"{std:.6g}" for name, std in zip(joints, reading.angle_stds)
        }
        status.values = [KeyValue(key=key, value=value) for key, value in said.items()]
        array = DiagnosticArray()
        array.header.stamp = stamp
        array.status = [status]
        self._health.publish(array)

    def _empty(self):
        return np.full(len(self._live.channels), np.nan)


def seconds(stamp):
    """Return a stamp of ROS in seconds."""
    return stamp.sec + 1e-9 * stamp.nanosec


def drives_by_name(given, drives):
    """Return name in the messages → drive of the rig, from `name:drive` each; without these the drives' own names."""
    pairs = [text.split(":") for text in given if text]
    wrong = [":".join(pair) for pair in pairs if len(pair) != 2 or pair[1] not in drives]
    if wrong:
        raise ValueError(
            f"names: {wrong} came; each is name:drive, and the rig has the drives {drives}"
        )
    return dict(pairs) if pairs else {drive: drive for drive in drives}


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
