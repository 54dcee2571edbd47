// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// The fields of the messages that are written, as ROS 2 lists them.
const separator = '\n' + '='.repeat(80) + '\n';
const parts = {
  'builtin_interfaces/Time': 'int32 sec\nuint32 nanosec\n',
  'std_msgs/Header': 'builtin_interfaces/Time stamp\nstring frame_id\n',
  'sensor_msgs/PointField': 'string name\nuint32 offset\nuint8 datatype\nuint32 count\n',
  'geometry_msgs/Point': 'float64 x\nfloat64 y\nfloat64 z\n',
  'geometry_msgs/Vector3': 'float64 x\nfloat64 y\nfloat64 z\n',
  'geometry_msgs/Quaternion': 'float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n',
  'geometry_msgs/Pose': 'geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n',
  'geometry_msgs/Twist': 'geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n',
  'geometry_msgs/PoseWithCovariance': 'geometry_msgs/Pose pose\nfloat64[36] covariance\n',
  'geometry_msgs/TwistWithCovariance': 'geometry_msgs/Twist twist\nfloat64[36] covariance\n',
  'geometry_msgs/Transform': 'geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n',
  'geometry_msgs/TransformStamped':
    'std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n',
  'livox_ros_driver2/CustomPoint':
    'uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\nuint8 reflectivity\nuint8 tag\nuint8 line\n',
};
const messages = {
  'sensor_msgs/PointCloud2':
    'std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\nbool is_bigendian\n' +
    'uint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense\n',
  'livox_ros_driver2/CustomMsg':
    'std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\nuint8[3] rsvd\n' +
    'livox_ros_driver2/CustomPoint[] points\n',
  'nav_msgs/Odometry':
    'std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n' +
    'geometry_msgs/TwistWithCovariance twist\n',
  'geometry_msgs/PoseStamped': 'std_msgs/Header header\ngeometry_msgs/Pose pose\n',
  'sensor_msgs/Imu':
    'std_msgs/Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n' +
    'geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n' +
    'geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance\n',
  'tf2_msgs/TFMessage': 'geometry_msgs/TransformStamped[] transforms\n',
  'std_msgs/String': 'string data\n',
};

/// The definition of a message with all that it contains.
export function definitionOf(type) {
  let text = messages[type];
  for (const [name, part] of Object.entries(parts)) text += `${separator}MSG: ${name}\n${part}`;
  return text;
}
