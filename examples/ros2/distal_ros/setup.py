from setuptools import setup

setup(
    name="distal_ros",
    version="0.1.0",
    packages=["distal_ros"],
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/distal_ros"]),
        ("share/distal_ros", ["package.xml"]),
        ("share/distal_ros/launch", ["launch/estimate.launch.py"]),
    ],
    install_requires=["setuptools", "distal"],
    zip_safe=True,
    license="BSD-3-Clause",
    entry_points={"console_scripts": ["estimate = distal_ros.node:main"]},
)
