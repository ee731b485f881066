"""ROS 2 environments for the tests: for each distribution one of wheels, and of messages that have no wheel.

    python tests/ros/build.py [DISTRIBUTION ...]

They are built once, below $CARTIER_TEST_ROS (by default ~/.cache/cartier/ros), and need cmake, make, g++ and Python
3.11, which the wheels are for. DISTRIBUTION/env has the variables for a shell: ``set -a; . FOLDER/env; set +a``.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

FOLDER = Path(os.environ.get("CARTIER_TEST_ROS") or "~/.cache/cartier/ros").expanduser()
MESSAGES = ["ros-sensor-msgs", "ros-nav-msgs", "ros-visualization-msgs"]
WHEELS = {
    "jazzy": ["ros-rclpy==7.1.6", "ros-jazzy-rmw-fastrtps-cpp", *MESSAGES],
    "kilted": ["ros-rclpy==9.1.2", "ros-rmw-fastrtps-cpp", "ros-ament-cmake-ros-core", *MESSAGES],
}
TOOLS = ["ros-ament-cmake", "ros-ament-cmake-gmock", "ros-ament-cmake-gtest", "ros-ament-cmake-include-directories",
         "ros-ament-cmake-pytest", "ros-ament-cmake-ros", "ros-ament-package", "ros-python-cmake-module",
         "catkin_pkg", "empy==3.3.4"]  # fmt: skip

GENERATORS = ["rosidl_cmake", "rosidl_generator_type_description", "rosidl_generator_c", "rosidl_generator_py",
              "rosidl_typesupport_fastrtps_c", "rosidl_typesupport_c"]  # fmt: skip

HEADER = "std_msgs/Header header\n"
HYPOTHESES = HEADER + "ObjectHypothesisWithPose[] results\n"
DEFINITIONS = {  # package -> what it needs, and its files
    "tf2_msgs": (["geometry_msgs"], {"msg/TFMessage.msg": "geometry_msgs/TransformStamped[] transforms\n"}),
    "vision_msgs": (
        ["std_msgs", "geometry_msgs"],
        {
            "msg/Point2D.msg": "float64 x\nfloat64 y\n",
            "msg/Pose2D.msg": "vision_msgs/Point2D position\nfloat64 theta\n",
            "msg/BoundingBox2D.msg": "vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y\n",
            "msg/BoundingBox3D.msg": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\n",
            "msg/ObjectHypothesis.msg": "string class_id\nfloat64 score\n",
            "msg/ObjectHypothesisWithPose.msg": (
                "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose\n"
            ),
            "msg/Detection2D.msg": HYPOTHESES + "BoundingBox2D bbox\nstring id\n",
            "msg/Detection2DArray.msg": HEADER + "vision_msgs/Detection2D[] detections\n",
            "msg/Detection3D.msg": HYPOTHESES + "BoundingBox3D bbox\nstring id\n",
            "msg/Detection3DArray.msg": HEADER + "vision_msgs/Detection3D[] detections\n",
        },
    ),
    "nav2_msgs": (
        ["geometry_msgs", "action_msgs", "builtin_interfaces"],
        {
            "action/NavigateToPose.action": (
                "geometry_msgs/PoseStamped pose\nstring behavior_tree\n---\n"
                "uint16 NONE=0\nuint16 error_code\nstring error_msg\n---\n"
                "geometry_msgs/PoseStamped current_pose\nbuiltin_interfaces/Duration navigation_time\n"
                "builtin_interfaces/Duration estimated_time_remaining\nint16 number_of_recoveries\n"
                "float32 distance_remaining\n"
            )
        },
    ),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("distribution", nargs="*", choices=[*WHEELS, []], help="by default all")
    for name in parser.parse_args().distribution or WHEELS:
        print(f"{name}: {build(name)}", flush=True)


def build(name: str) -> Path:
    """The folder of a distribution's environment, built if it is not there or is made of something else."""
    if sys.version_info[:2] != (3, 11):
        raise SystemExit("the wheels of ROS 2 are for Python 3.11: start this script with it")
    venv = FOLDER / name
    version = hashlib.sha256(repr((WHEELS[name], TOOLS, GENERATORS, DEFINITIONS)).encode()).hexdigest()
    done = venv / "built"
    if done.is_file() and done.read_text() == version:
        return venv
    shutil.rmtree(venv, ignore_errors=True)
    _run(sys.executable, "-m", "venv", str(venv))
    _run(str(venv / "bin/pip"), "install", "--quiet", "--disable-pip-version-check", *WHEELS[name], *TOOLS)
    _mend(venv)
    (venv / "env").write_text("".join(f"{key}={value}\n" for key, value in variables(venv).items()))
    for package in DEFINITIONS:
        _build_package(package, venv)
    done.write_text(version)
    return venv


def variables(venv: Path) -> dict[str, str]:
    """What a shell sources of ROS, and that all of it stays on this machine."""
    return {
        "PATH": f"{venv}/bin:/usr/local/bin:/usr/bin:/bin",
        "AMENT_PREFIX_PATH": str(venv),
        "CMAKE_PREFIX_PATH": str(venv),
        "LD_LIBRARY_PATH": f"{venv}/lib",
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    }


def _mend(venv: Path) -> None:
    """The wheels' cmake files name the Python of the machine that built them."""
    import_numpy = "import numpy; print(numpy.get_include())"
    numpy = _run(str(venv / "bin/python"), "-c", import_numpy).strip()
    for file in (venv / "share").rglob("*.cmake"):
        text = file.read_text()
        mended = re.sub(r"/opt/python/cp3\d+-cp3\d+/lib/python3\.\d+/site-packages/numpy/_core/include", numpy, text)
        mended = re.sub(r"/opt/python/cp3\d+-cp3\d+/include/python3\.\d+", sysconfig.get_path("include"), mended)
        if mended != text:
            file.write_text(mended)


def _build_package(package: str, venv: Path) -> None:
    needs, files = DEFINITIONS[package]
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder)
        for name, text in files.items():
            (source / name).parent.mkdir(exist_ok=True)
            (source / name).write_text(text)
        found = "\n".join(f"find_package({need} REQUIRED)" for need in ["ament_cmake", *GENERATORS, *needs])
        names = " ".join(f'"{name}"' for name in files)
        (source / "CMakeLists.txt").write_text(
            f"cmake_minimum_required(VERSION 3.8)\nproject({package})\n{found}\n"
            f"rosidl_generate_interfaces({package} {names} DEPENDENCIES {' '.join(needs)})\nament_package()\n"
        )
        depends = "".join(f"<depend>{need}</depend>" for need in needs)
        (source / "package.xml").write_text(
            f'<package format="3"><name>{package}</name><version>0.0.1</version><description>of the tests</description>'
            '<maintainer email="nobody@example.com">nobody</maintainer><license>Apache-2.0</license>'
            "<buildtool_depend>ament_cmake</buildtool_depend><buildtool_depend>rosidl_cmake</buildtool_depend>"
            f"{depends}<exec_depend>rosidl_default_runtime</exec_depend>"
            "<member_of_group>rosidl_interface_packages</member_of_group>"
            "<export><build_type>ament_cmake</build_type></export></package>\n"
        )
        environment = {**os.environ, **variables(venv)}
        python = f"-DPython3_EXECUTABLE={venv}/bin/python"
        build = str(source / "build")
        options = [f"-DCMAKE_INSTALL_PREFIX={venv}", python, "-DBUILD_TESTING=OFF", "-DCMAKE_CXX_FLAGS=-O0"]
        _run("cmake", "-S", folder, "-B", build, *options, env=environment)
        _run("cmake", "--build", build, "--parallel", "2", "--target", "install", env=environment)


def _run(*command: str, env: dict[str, str] | None = None) -> str:
    done = subprocess.run(command, env=env, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)}\n{done.stdout[-6000:]}")
    return done.stdout


if __name__ == "__main__":
    main()
