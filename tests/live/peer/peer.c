/* Copyright Contributors to the AccessVDB project
 * SPDX-License-Identifier: Apache-2.0
 *
 * A scanner and its odometry as a program of ROS 2 would publish them, over Cyclone DDS, and somebody who listens to a
 * live map. Shares no code with the project.
 *
 *   live_peer STREAM domain=N rate=HZ [reliable=0|1] [first=N] [count=N] [die=N] [large=N] [listen=PREFIX] [wait_s=S]
 *             [pose_stamps=FILE] [poses=0|1] [odometry=FILE] [times=0|1] [livox=0|1] [frame=NAME] [child=NAME]
 *             [world=NAME] [imu=0|1] [static_tf=FILE]
 *
 * STREAM: for each scan int64 stamp_ns, 3 doubles, 4 doubles x y z w, uint32 n, n x 3 floats; little-endian.
 * rate=0: as fast as it can. die=N: it is killed after N scans.
 * large=N: after N scans comes one of 3 MB more, which is not counted. listen: writes PREFIX.status (the last one),
 * PREFIX.points (the data of the last message with all points), PREFIX.changes (the data of all messages with changed
 * points, one after the other). pose_stamps: int64 for each scan, the stamps of the odometry instead of those of the
 * scans. poses=0: clouds alone. odometry: instead, int64 stamp_ns, 3 doubles, 4 doubles x y z w, for each pose: all up
 * to the end of a scan come before it. times=1: after its points, a scan of STREAM has n x uint32, when each was
 * measured in ns since its stamp. livox=1: clouds are sent as CustomMsg. frame, child: of clouds and odometry, both
 * "body"; world: what the odometry is in, "odom". imu=1: before each scan what an accelerometer felt five times in the
 * last tenth of a second: up in "world" is (0.04, 0.02, 1). Prints "published N" at the end. */
#include <dds/dds.h>
#include <inttypes.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "ros_messages.h"

typedef sensor_msgs_msg_dds__PointCloud2_ Cloud;
typedef nav_msgs_msg_dds__Odometry_ Odometry;
typedef livox_ros_driver2_msg_dds__CustomMsg_ Livox;
typedef livox_ros_driver2_msg_dds__CustomPoint_ LivoxPoint;
typedef std_msgs_msg_dds__String_ Text;

static void check(dds_return_t code, const char* what) {
  if (code >= 0) return;
  fprintf(stderr, "live_peer: %s: %s\n", what, dds_strretcode(-code));
  exit(1);
}

static double argument(int argc, char** argv, const char* name, double otherwise) {
  for (int i = 2; i < argc; ++i) {
    const size_t length = strlen(name);
    if (strncmp(argv[i], name, length) == 0 && argv[i][length] == '=') return atof(argv[i] + length + 1);
  }
  return otherwise;
}

static const char* word(int argc, char** argv, const char* name) {
  for (int i = 2; i < argc; ++i) {
    const size_t length = strlen(name);
    if (strncmp(argv[i], name, length) == 0 && argv[i][length] == '=') return argv[i] + length + 1;
  }
  return NULL;
}

static void need(size_t got, size_t wanted) {
  if (got == wanted) return;
  fprintf(stderr, "live_peer: the stream ends inside a scan\n");
  exit(1);
}

static FILE* openOut(const char* prefix, const char* suffix) {
  char path[1000];
  snprintf(path, sizeof path, "%s.%s", prefix, suffix);
  FILE* file = fopen(path, "wb");
  if (file == NULL) {
    perror(path);
    exit(1);
  }
  return file;
}

static void setStamp(std_msgs_msg_dds__Header_* header, int64_t stamp_ns) {
  header->stamp.sec = (int32_t)(stamp_ns / 1000000000);
  header->stamp.nanosec = (uint32_t)(stamp_ns % 1000000000);
}

/* pose: x y z, qx qy qz qw */
static void sendPose(dds_entity_t odometry, int64_t stamp_ns, const double* pose, char* world, char* child) {
  Odometry odom;
  memset(&odom, 0, sizeof odom);
  setStamp(&odom.header, stamp_ns);
  odom.header.frame_id = world;
  odom.child_frame_id = child;
  odom.pose.pose.position.x = pose[0];
  odom.pose.pose.position.y = pose[1];
  odom.pose.pose.position.z = pose[2];
  odom.pose.pose.orientation.x = pose[3];
  odom.pose.pose.orientation.y = pose[4];
  odom.pose.pose.orientation.z = pose[5];
  odom.pose.pose.orientation.w = pose[6];
  check(dds_write(odometry, &odom), "odometry");
}

static void sendImu(dds_entity_t imu, int64_t stamp_ns, const double* pose, char* child) {
  const double qx = -pose[3], qy = -pose[4], qz = -pose[5], qw = pose[6], up[3] = {0.4, 0.2, 10};
  /* v + 2 q x (q x v + w v), by the inverse of the pose's rotation */
  const double tx = qy * up[2] - qz * up[1] + qw * up[0], ty = qz * up[0] - qx * up[2] + qw * up[1],
               tz = qx * up[1] - qy * up[0] + qw * up[2];
  sensor_msgs_msg_dds__Imu_ felt;
  memset(&felt, 0, sizeof felt);
  felt.header.frame_id = child;
  felt.linear_acceleration.x = up[0] + 2 * (qy * tz - qz * ty);
  felt.linear_acceleration.y = up[1] + 2 * (qz * tx - qx * tz);
  felt.linear_acceleration.z = up[2] + 2 * (qx * ty - qy * tx);
  for (int n = 4; n >= 0; --n) {
    setStamp(&felt.header, stamp_ns - 20000000 * n);
    check(dds_write(imu, &felt), "imu");
  }
}

/* Those of a file up to a time. */
struct PoseFile {
  FILE* file;
  int64_t stamp_ns;
  double pose[7];
  int has_next;
};
static void readPose(struct PoseFile* poses) {
  poses->has_next = fread(&poses->stamp_ns, sizeof poses->stamp_ns, 1, poses->file) == 1 &&
                    fread(poses->pose, sizeof(double), 7, poses->file) == 7;
}
static void sendPosesUntil(struct PoseFile* poses, int64_t end_ns, dds_entity_t odometry, char* world, char* child) {
  for (; poses->has_next && poses->stamp_ns <= end_ns; readPose(poses))
    sendPose(odometry, poses->stamp_ns, poses->pose, world, child);
}

static void sendTransforms(dds_entity_t writer, const char* path) {
  enum { kMost = 20 };
  static char names[kMost][2][100];
  static geometry_msgs_msg_dds__TransformStamped_ sent[kMost];
  FILE* file = fopen(path, "r");
  if (file == NULL) {
    perror(path);
    exit(1);
  }
  tf2_msgs_msg_dds__TFMessage_ message;
  memset(&message, 0, sizeof message);
  message.transforms._buffer = sent;
  uint32_t count = 0;
  for (; count < kMost; ++count) {
    geometry_msgs_msg_dds__Transform_* to = &sent[count].transform;
    if (fscanf(file, "%99s %99s %lf %lf %lf %lf %lf %lf %lf", names[count][0], names[count][1], &to->translation.x,
               &to->translation.y, &to->translation.z, &to->rotation.x, &to->rotation.y, &to->rotation.z,
               &to->rotation.w) != 9)
      break;
    sent[count].header.frame_id = names[count][0];
    sent[count].child_frame_id = names[count][1];
  }
  fclose(file);
  message.transforms._length = message.transforms._maximum = count;
  check(dds_write(writer, &message), "transforms");
}

static void sendLivox(dds_entity_t clouds, int64_t stamp_ns, char* frame, uint32_t points, const float* xyz,
                      const uint32_t* times_ns) {
  Livox message;
  memset(&message, 0, sizeof message);
  setStamp(&message.header, stamp_ns);
  message.header.frame_id = frame;
  message.timebase = (uint64_t)stamp_ns;
  message.point_num = points;
  message.points._buffer = calloc(points + 1, sizeof(LivoxPoint));
  message.points._length = message.points._maximum = points;
  for (uint32_t i = 0; i < points; ++i) {
    LivoxPoint* to = message.points._buffer + i;
    to->offset_time = times_ns[i];
    to->x = xyz[3 * i];
    to->y = xyz[3 * i + 1];
    to->z = xyz[3 * i + 2];
  }
  check(dds_write(clouds, &message), "cloud");
  free(message.points._buffer);
}

struct Ears {
  const char* prefix;
  dds_entity_t points, changes, status;
  int64_t last_points_ns;
  FILE* changes_file;
};

static void listenTo(struct Ears* ears) {
  if (ears->prefix == NULL) return;
  void* sample = NULL;
  dds_sample_info_t info;
  while (dds_take(ears->status, &sample, &info, 1, 1) > 0) {
    if (info.valid_data) {
      FILE* file = openOut(ears->prefix, "status");
      fputs(((Text*)sample)->data, file);
      fclose(file);
    }
    dds_return_loan(ears->status, &sample, 1);
    sample = NULL;
  }
  while (dds_take(ears->changes, &sample, &info, 1, 1) > 0) {
    if (info.valid_data) {
      const Cloud* cloud = sample;
      fwrite(cloud->data._buffer, 1, cloud->data._length, ears->changes_file);
      fflush(ears->changes_file);
    }
    dds_return_loan(ears->changes, &sample, 1);
    sample = NULL;
  }
  while (dds_take(ears->points, &sample, &info, 1, 1) > 0) {
    if (info.valid_data) {
      const Cloud* cloud = sample;
      ears->last_points_ns = (int64_t)cloud->header.stamp.sec * 1000000000 + cloud->header.stamp.nanosec;
      FILE* file = openOut(ears->prefix, "points");
      fwrite(cloud->data._buffer, 1, cloud->data._length, file);
      fclose(file);
      file = openOut(ears->prefix, "layout");
      fprintf(file, "%s %u x %u, %u bytes per point:", cloud->header.frame_id, cloud->height, cloud->width,
              cloud->point_step);
      for (uint32_t i = 0; i < cloud->fields._length; ++i) {
        fprintf(file, " %s@%u/%u", cloud->fields._buffer[i].name, cloud->fields._buffer[i].offset,
                cloud->fields._buffer[i].datatype);
      }
      fclose(file);
    }
    dds_return_loan(ears->points, &sample, 1);
    sample = NULL;
  }
}

static uint32_t readersOf(dds_entity_t writer) {
  dds_publication_matched_status_t status;
  check(dds_get_publication_matched_status(writer, &status), "matched");
  return status.current_count;
}
static uint32_t writersOf(dds_entity_t reader) {
  dds_subscription_matched_status_t status;
  check(dds_get_subscription_matched_status(reader, &status), "matched");
  return status.current_count;
}

static void waitUntil(dds_time_t when, struct Ears* ears) {
  for (dds_time_t now = dds_time(); now < when; now = dds_time()) {
    listenTo(ears);
    const dds_time_t left = when - now;
    dds_sleepfor(left < DDS_MSECS(10) ? left : DDS_MSECS(10));
  }
}

int main(int argc, char** argv) {
  if (argc < 2) return 2;
  FILE* stream = fopen(argv[1], "rb");
  if (stream == NULL) {
    perror(argv[1]);
    return 1;
  }
  FILE* pose_stamps = NULL;
  if (word(argc, argv, "pose_stamps") != NULL && (pose_stamps = fopen(word(argc, argv, "pose_stamps"), "rb")) == NULL) {
    perror("pose_stamps");
    return 1;
  }
  const int with_times = argument(argc, argv, "times", 0) > 0, livox = argument(argc, argv, "livox", 0) > 0;
  char* const frame = (char*)(word(argc, argv, "frame") != NULL ? word(argc, argv, "frame") : "body");
  char* const child = (char*)(word(argc, argv, "child") != NULL ? word(argc, argv, "child") : "body");
  char* const world = (char*)(word(argc, argv, "world") != NULL ? word(argc, argv, "world") : "odom");
  struct PoseFile poses = {NULL, 0, {0}, 0};
  if (word(argc, argv, "odometry") != NULL) {
    if ((poses.file = fopen(word(argc, argv, "odometry"), "rb")) == NULL) {
      perror("odometry");
      return 1;
    }
    readPose(&poses);
  }
  const int with_poses = poses.file == NULL && argument(argc, argv, "poses", 1) > 0;
  const double rate = argument(argc, argv, "rate", 10);
  const long first = (long)argument(argc, argv, "first", 0), count = (long)argument(argc, argv, "count", 1e9),
             die = (long)argument(argc, argv, "die", -1), large = (long)argument(argc, argv, "large", -1);
  const dds_entity_t participant =
      dds_create_participant((dds_domainid_t)argument(argc, argv, "domain", 0), NULL, NULL);
  check(participant, "participant");

  dds_qos_t* qos = dds_create_qos();
  if (argument(argc, argv, "reliable", 1) > 0) {
    dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_SECS(60));
    dds_qset_history(qos, DDS_HISTORY_KEEP_ALL, 0);
  } else {
    dds_qset_reliability(qos, DDS_RELIABILITY_BEST_EFFORT, 0);
    dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 5);
  }
  const dds_entity_t cloud_topic = dds_create_topic(
      participant, livox ? &livox_ros_driver2_msg_dds__CustomMsg__desc : &sensor_msgs_msg_dds__PointCloud2__desc,
      "rt/livox/lidar", NULL, NULL);
  const dds_entity_t odom_topic =
      dds_create_topic(participant, &nav_msgs_msg_dds__Odometry__desc, "rt/Odometry", NULL, NULL);
  check(cloud_topic, "topic of clouds");
  check(odom_topic, "topic of odometry");
  const dds_entity_t clouds = dds_create_writer(participant, cloud_topic, qos, NULL);
  const dds_entity_t odometry = dds_create_writer(participant, odom_topic, qos, NULL);
  check(clouds, "writer of clouds");
  check(odometry, "writer of odometry");

  dds_entity_t imu = 0;
  if (argument(argc, argv, "imu", 0) > 0) {
    const dds_entity_t topic = dds_create_topic(participant, &sensor_msgs_msg_dds__Imu__desc, "rt/imu", NULL, NULL);
    check(topic, "topic of the imu");
    imu = dds_create_writer(participant, topic, qos, NULL);
    check(imu, "writer of the imu");
  }

  dds_entity_t transforms = 0;
  if (word(argc, argv, "static_tf") != NULL) {
    dds_qos_t* latched = dds_create_qos();
    dds_qset_reliability(latched, DDS_RELIABILITY_RELIABLE, DDS_SECS(60));
    dds_qset_durability(latched, DDS_DURABILITY_TRANSIENT_LOCAL);
    dds_qset_history(latched, DDS_HISTORY_KEEP_LAST, 1);
    const dds_entity_t topic =
        dds_create_topic(participant, &tf2_msgs_msg_dds__TFMessage__desc, "rt/tf_static", NULL, NULL);
    check(topic, "topic of transforms");
    transforms = dds_create_writer(participant, topic, latched, NULL);
    check(transforms, "writer of transforms");
    dds_delete_qos(latched);
  }

  struct Ears ears = {word(argc, argv, "listen"), 0, 0, 0, 0, NULL};
  if (ears.prefix != NULL) {
    dds_qos_t* reliable = dds_create_qos();
    dds_qset_reliability(reliable, DDS_RELIABILITY_RELIABLE, DDS_SECS(1));
    dds_qset_history(reliable, DDS_HISTORY_KEEP_ALL, 0);
    const struct {
      dds_entity_t* reader;
      const dds_topic_descriptor_t* type;
      const char* name;
    } outputs[] = {{&ears.points, &sensor_msgs_msg_dds__PointCloud2__desc, "rt/accessvdb/points"},
                   {&ears.changes, &sensor_msgs_msg_dds__PointCloud2__desc, "rt/accessvdb/changes"},
                   {&ears.status, &std_msgs_msg_dds__String__desc, "rt/accessvdb/status"}};
    for (int i = 0; i < 3; ++i) {
      const dds_entity_t topic = dds_create_topic(participant, outputs[i].type, outputs[i].name, NULL, NULL);
      check(topic, outputs[i].name);
      *outputs[i].reader = dds_create_reader(participant, topic, reliable, NULL);
      check(*outputs[i].reader, outputs[i].name);
    }
    dds_delete_qos(reliable);
    ears.changes_file = openOut(ears.prefix, "changes");
  }

  const dds_time_t give_up = dds_time() + DDS_SECS(30);
  while (readersOf(clouds) == 0 || readersOf(odometry) == 0 || (imu > 0 && readersOf(imu) == 0) ||
         (ears.prefix != NULL &&
          (writersOf(ears.points) == 0 || writersOf(ears.changes) == 0 || writersOf(ears.status) == 0))) {
    if (dds_time() > give_up) {
      fprintf(stderr, "live_peer: nobody to talk to after 30 s\n");
      return 1;
    }
    dds_sleepfor(DDS_MSECS(20));
  }
  // Both sides must have seen the match: the other one finds out a little later.
  dds_sleepfor(DDS_MSECS(1500));

  const uint32_t columns = with_times ? 4 : 3, point_bytes = 4 * columns;
  sensor_msgs_msg_dds__PointField_ fields[4];
  memset(fields, 0, sizeof fields);
  char* names[4] = {"x", "y", "z", "t"};
  for (uint32_t i = 0; i < columns; ++i) {
    fields[i].name = names[i];
    fields[i].offset = 4 * i;
    fields[i].datatype = i < 3 ? 7 : 6;
    fields[i].count = 1;
  }
  long number = 0, published = 0;
  int64_t stamp_ns = 0;
  const dds_time_t start = dds_time();
  for (; published < count && fread(&stamp_ns, sizeof stamp_ns, 1, stream) == 1; ++number) {
    double pose[7];
    uint32_t points = 0;
    need(fread(pose, sizeof(double), 7, stream), 7);
    need(fread(&points, sizeof points, 1, stream), 1);
    int64_t pose_stamp_ns = stamp_ns;
    if (pose_stamps != NULL) need(fread(&pose_stamp_ns, sizeof pose_stamp_ns, 1, pose_stamps), 1);
    float* xyz = malloc(12 * (size_t)points + 1);
    need(fread(xyz, 12, points, stream), points);
    uint32_t* times_ns = calloc((size_t)points + 1, 4);
    if (with_times) need(fread(times_ns, 4, points, stream), points);
    if (number >= first) {
      if (rate > 0) waitUntil(start + (dds_time_t)(1e9 * (double)published / rate), &ears);
      if (imu > 0) sendImu(imu, pose_stamp_ns, pose, child);
      if (with_poses) sendPose(odometry, pose_stamp_ns, pose, world, child);
      if (poses.file != NULL) sendPosesUntil(&poses, stamp_ns + 110000000, odometry, world, child);
      Cloud cloud;
      memset(&cloud, 0, sizeof cloud);
      setStamp(&cloud.header, stamp_ns);
      cloud.header.frame_id = frame;
      cloud.height = 1;
      cloud.width = points;
      cloud.fields._buffer = fields;
      cloud.fields._length = cloud.fields._maximum = columns;
      cloud.point_step = point_bytes;
      cloud.row_step = point_bytes * points;
      cloud.data._buffer = malloc((size_t)point_bytes * points + 1);
      cloud.data._length = cloud.data._maximum = point_bytes * points;
      for (uint32_t i = 0; i < points; ++i) {
        memcpy(cloud.data._buffer + (size_t)point_bytes * i, xyz + 3 * (size_t)i, 12);
        if (with_times) memcpy(cloud.data._buffer + (size_t)point_bytes * i + 12, times_ns + i, 4);
      }
      cloud.is_dense = true;
      if (livox)
        sendLivox(clouds, stamp_ns, frame, points, xyz, times_ns);
      else
        check(dds_write(clouds, &cloud), "cloud");
      free(cloud.data._buffer);
      ++published;
      if (transforms > 0 && published == 1) sendTransforms(transforms, word(argc, argv, "static_tf"));
      listenTo(&ears);
      if (published == die) raise(SIGKILL);
      if (published == large) {
        const uint32_t count = 250000;
        cloud.header.stamp.nanosec += 1000;
        cloud.width = count;
        cloud.row_step = point_bytes * count;
        cloud.data._length = cloud.data._maximum = point_bytes * count;
        cloud.data._buffer = calloc(count, point_bytes);
        check(dds_write(clouds, &cloud), "large cloud");
        free(cloud.data._buffer);
      }
    }
    free(xyz);
    free(times_ns);
  }
  if (poses.file != NULL) sendPosesUntil(&poses, INT64_MAX, odometry, world, child);
  if (argument(argc, argv, "reliable", 1) > 0) {
    check(dds_wait_for_acks(odometry, DDS_SECS(60)), "odometry did not arrive");
    check(dds_wait_for_acks(clouds, DDS_SECS(60)), "clouds did not arrive");
  }
  // Until the map has shown the last scan.
  const dds_time_t end = dds_time() + (dds_time_t)(1e9 * argument(argc, argv, "wait_s", 20));
  while (ears.prefix != NULL && ears.last_points_ns != stamp_ns && dds_time() < end)
    waitUntil(dds_time() + DDS_MSECS(50), &ears);
  waitUntil(dds_time() + DDS_MSECS(2000), &ears);  // for a message that was lost and is sent again
  printf("published %ld\n", published);
  check(dds_delete(participant), "end");
  return 0;
}
