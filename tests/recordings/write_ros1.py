# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Writes a ROS 1 bag from a folder of scans and poses, with Debian's python3-rosbag and the messages of ROS itself.

write_ros1.py SCANS OUT.bag [name=value ...]
clouds: sensor | livox     compression: none | bz2 | lz4     chunk: bytes     poses: odometry | tf
"""
import struct
import sys
from pathlib import Path

import genpy
import genpy.dynamic
import rosbag
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import PointCloud2, PointField
from tf2_msgs.msg import TFMessage

LIVOX = """std_msgs/Header header
uint64 timebase
uint32 point_num
uint8 lidar_id
uint8[3] rsvd
CustomPoint[] points
================================================================================
MSG: livox_ros_driver/CustomPoint
uint32 offset_time
float32 x
float32 y
float32 z
uint8 reflectivity
uint8 tag
uint8 line
================================================================================
MSG: std_msgs/Header
uint32 seq
time stamp
string frame_id
"""


def points_of(path):
    """The x y z of a PCD file, as float32 triples."""
    data = path.read_bytes()
    begin = data.index(b"\n", data.index(b"DATA ")) + 1
    lines = dict(line.split(" ", 1) for line in data[:begin].decode("latin1").splitlines() if " " in line)
    count = int(lines["POINTS"])
    if lines["DATA"] == "binary":
        size = sum(int(word) for word in lines["SIZE"].split())
        return [struct.unpack_from("<3f", data, begin + i * size) for i in range(count)]
    rows = data[begin:].decode("latin1").split("\n")
    return [tuple(float(word) for word in row.split()[:3]) for row in rows if row.strip()]


def cloud_message(header, points):
    cloud = PointCloud2(header=header, height=1, width=len(points), point_step=16, row_step=16 * len(points))
    cloud.fields = [PointField(name, 4 * i, PointField.FLOAT32, 1) for i, name in enumerate(("intensity", "x", "y", "z"))]
    cloud.data = b"".join(struct.pack("<4f", 1, *point) for point in points)
    return cloud


def livox_message(types, header, points):
    message = types["livox_ros_driver/CustomMsg"](header=header, timebase=header.stamp.to_nsec(), lidar_id=1)
    message.rsvd = bytes(3)
    custom_point = types["livox_ros_driver/CustomPoint"]
    message.points = [custom_point(0, *point, 7, 16, i % 4) for i, point in enumerate(points)]
    message.point_num = len(message.points)
    return message


def main():
    folder, out = Path(sys.argv[1]), sys.argv[2]
    wanted = dict(word.split("=", 1) for word in sys.argv[3:])
    types = genpy.dynamic.generate_dynamic("livox_ros_driver/CustomMsg", LIVOX)
    poses = [[float(word) for word in line.split()] for line in (folder / "poses.txt").read_text().splitlines()
             if line.strip() and not line.startswith("#")]
    scans = sorted((folder / "scans").glob("*.pcd"))
    chunk = int(wanted.get("chunk", 100_000))
    with rosbag.Bag(out, "w", compression=wanted.get("compression", "none"), chunk_threshold=chunk) as bag:
        for row, scan in zip(poses, scans):
            stamp = genpy.Time.from_sec(1.7e9) + genpy.Duration(0, round(row[0] * 1e9))
            cloud_header = Odometry().header
            cloud_header.stamp, cloud_header.frame_id = stamp, "body"
            points = points_of(scan)
            odometry = Odometry(child_frame_id="body")
            odometry.header.stamp, odometry.header.frame_id = stamp, "/camera_init"
            pose = odometry.pose.pose
            pose.position.x, pose.position.y, pose.position.z = row[1:4]
            pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w = row[4:8]
            if wanted.get("poses") == "tf":
                transform = TransformStamped(header=odometry.header, child_frame_id="body")
                transform.transform.translation = pose.position
                transform.transform.rotation = pose.orientation
                bag.write("/tf", TFMessage([transform]), stamp)
            else:
                bag.write("/Odometry", odometry, stamp)
            if wanted.get("clouds") == "livox":
                bag.write("/livox/lidar", livox_message(types, cloud_header, points), stamp)
            else:
                bag.write("/points", cloud_message(cloud_header, points), stamp)


main()
