from launch import LaunchDescription
from launch_ros.actions import Node


def generate_launch_description():
    return LaunchDescription(
        [
            Node(
                package="distal_ros",
                executable="estimate",
                parameters=[
                    {
                        "rig": "capstan-joint",
                        "topics": ["/joint_states"],
                        "names": ["motor_1:motor"],
                    }
                ],
            )
        ]
    )
