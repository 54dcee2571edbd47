/* Copyright Contributors to the AccessVDB project
 * SPDX-License-Identifier: Apache-2.0
 *
 * Sends bytes that are not what the type's name says.
 *
 *   live_garbage_peer domain=N count=N [bytes=N] [reliable=0|1] [topic=cloud|odom|tf|command] [as=cloud|odom]
 * [die_us=N]
 *
 * bytes: the size of each message instead of 0 .. 4000 by chance. Half of the small ones begin like a cloud, so that
 * what is wrong comes late. as: under the name of the other type, which nobody is to subscribe to. die_us: it is killed
 * so long after it has begun to send, inside a message. Prints "published N". */
#include <dds/dds.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "garbage_messages.h"

static const char* word(int argc, char** argv, const char* name, const char* otherwise) {
  const size_t length = strlen(name);
  for (int i = 1; i < argc; ++i)
    if (strncmp(argv[i], name, length) == 0 && argv[i][length] == '=') return argv[i] + length + 1;
  return otherwise;
}

static void check(dds_return_t code, const char* what) {
  if (code >= 0) return;
  fprintf(stderr, "live_garbage_peer: %s: %s\n", what, dds_strretcode(-code));
  exit(1);
}

static uint64_t state = 88172645463325252ULL;
static uint64_t chance(void) {
  state ^= state << 13;
  state ^= state >> 7;
  state ^= state << 17;
  return state;
}

static void* dieLater(void* us) {
  dds_sleepfor(DDS_USECS(*(const long*)us));
  raise(SIGKILL);
  return NULL;
}

int main(int argc, char** argv) {
  const char* to = word(argc, argv, "topic", "cloud");
  const int wrong = strcmp(word(argc, argv, "as", to), to) != 0;
  long die_us = atol(word(argc, argv, "die_us", "0"));
  const long count = atol(word(argc, argv, "count", "100"));
  const size_t fixed = (size_t)atol(word(argc, argv, "bytes", "0"));
  const dds_entity_t participant =
      dds_create_participant((dds_domainid_t)atol(word(argc, argv, "domain", "0")), NULL, NULL);
  check(participant, "participant");
  dds_qos_t* qos = dds_create_qos();
  const int reliable = atol(word(argc, argv, "reliable", "1")) > 0;
  dds_qset_reliability(qos, reliable ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT, DDS_SECS(2));
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 100);
  const struct {
    const char *word, *name;
    const dds_topic_descriptor_t* type;
  } kTopics[] = {{"cloud", "rt/livox/lidar", &sensor_msgs_msg_dds__PointCloud2__desc},
                 {"odom", "rt/Odometry", &nav_msgs_msg_dds__Odometry__desc},
                 {"tf", "rt/tf", &tf2_msgs_msg_dds__TFMessage__desc},
                 {"command", "rt/accessvdb/command", &std_msgs_msg_dds__String__desc}};
  int where = 0, type = 0;
  for (int i = 0; i < 4; ++i) {
    if (strcmp(kTopics[i].word, to) == 0) where = i;
    if (strcmp(kTopics[i].word, word(argc, argv, "as", to)) == 0) type = i;
  }
  const dds_entity_t topic = dds_create_topic(participant, kTopics[type].type, kTopics[where].name, NULL, NULL);
  check(topic, "topic");
  const dds_entity_t writer = dds_create_writer(participant, topic, qos, NULL);
  check(writer, "writer");
  dds_publication_matched_status_t matched;
  for (int tries = 0; tries < 1500 && !wrong; ++tries) {
    check(dds_get_publication_matched_status(writer, &matched), "matched");
    if (matched.current_count > 0) break;
    dds_sleepfor(DDS_MSECS(20));
  }
  if (!wrong && matched.current_count == 0) {
    fprintf(stderr, "live_garbage_peer: nobody to talk to after 30 s\n");
    return 1;
  }
  dds_sleepfor(DDS_MSECS(1500));

  /* What follows the stamp's seconds, which the length of the sequence stands for: nanoseconds, a frame of four
   * letters, 1 x 2^32-1 points, a billion fields. */
  static const uint8_t kLikeCloud[] = {0, 0, 0, 0, 5, 0, 0,   0,   'b', 'o', 'd', 'y', 0, 0,
                                       0, 0, 1, 0, 0, 0, 255, 255, 255, 255, 0,   0,   0, 64};
  pthread_t killer;
  if (die_us > 0 && pthread_create(&killer, NULL, dieLater, &die_us) != 0) return 1;
  long published = 0;
  for (; published < count; ++published) {
    const size_t size = fixed > 0 ? fixed : (size_t)(chance() % 4000);
    uint8_t* bytes = malloc(size + 1);
    for (size_t i = 0; i < size; ++i) bytes[i] = (uint8_t)chance();
    if (published % 2 == 0 && size >= sizeof kLikeCloud) memcpy(bytes, kLikeCloud, sizeof kLikeCloud);
    /* All types are the same sequence of bytes. */
    sensor_msgs_msg_dds__PointCloud2_ sample;
    memset(&sample, 0, sizeof sample);
    sample.bytes._buffer = bytes;
    sample.bytes._length = sample.bytes._maximum = (uint32_t)size;
    check(dds_write(writer, &sample), "write");
    free(bytes);
    if (die_us == 0) dds_sleepfor(DDS_MSECS(fixed > 0 ? 100 : 2));
  }
  if (reliable) dds_wait_for_acks(writer, DDS_SECS(3));
  dds_sleepfor(DDS_MSECS(300));
  printf("published %ld\n", published);
  check(dds_delete(participant), "end");
  return 0;
}
