/* Copyright Contributors to the AccessVDB project
 * SPDX-License-Identifier: Apache-2.0
 *
 * Somebody who commands a live map, over Cyclone DDS, and waits for its answers.
 *
 *   live_command_peer domain=N commands=FILE answers=FILE [rate=HZ] [wait_s=S] [pause_s=S] [poses=FILE]
 *                     [poses_of=approaches|views]
 *
 * FILE: a command per line. The n-th, from 0, has n as its id if it contains "%d". Writes "n ms answer" for each id
 * that was answered, and at the end "sent N, answered N". poses: the last array of poses that came, its frame and then
 * "x y z qx qy qz qw" for each. */
#include <dds/dds.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ros_messages.h"

typedef std_msgs_msg_dds__String_ Text;

enum { kMostCommands = 1000, kMostLine = 2000000 };

static dds_time_t sent_at[kMostCommands], answered_at[kMostCommands];
static char* answers[kMostCommands];

static const char* word(int argc, char** argv, const char* name, const char* otherwise) {
  const size_t length = strlen(name);
  for (int i = 1; i < argc; ++i)
    if (strncmp(argv[i], name, length) == 0 && argv[i][length] == '=') return argv[i] + length + 1;
  return otherwise;
}

static void check(dds_return_t code, const char* what) {
  if (code >= 0) return;
  fprintf(stderr, "live_command_peer: %s: %s\n", what, dds_strretcode(-code));
  exit(1);
}

static void listen(dds_entity_t status, int sent) {
  void* sample = NULL;
  dds_sample_info_t info;
  while (dds_take(status, &sample, &info, 1, 1) > 0) {
    for (int n = 0; n < sent && info.valid_data; ++n) {
      char key[40];
      snprintf(key, sizeof key, "\"id\":%d,", n);
      const char* at = strstr(((Text*)sample)->data, key);
      if (at == NULL || answered_at[n] > 0) continue;
      answered_at[n] = dds_time();
      while (at > ((Text*)sample)->data && *at != '{') --at;
      const char* end = strchr(at, '}');
      answers[n] = end != NULL ? strndup(at, (size_t)(end - at) + 1) : strdup(at);
    }
    dds_return_loan(status, &sample, 1);
    sample = NULL;
  }
}

static void listenFor(dds_entity_t status, int sent, dds_duration_t time) {
  for (const dds_time_t end = dds_time() + time; dds_time() < end; dds_sleepfor(DDS_MSECS(2))) listen(status, sent);
}

static void writePoses(dds_entity_t reader, const char* name) {
  FILE* out = fopen(name, "w");
  if (out == NULL) {
    perror("poses");
    exit(1);
  }
  void* sample = NULL;
  dds_sample_info_t info;
  while (dds_take(reader, &sample, &info, 1, 1) > 0) {
    const geometry_msgs_msg_dds__PoseArray_* array = sample;
    if (info.valid_data) {
      rewind(out);
      fprintf(out, "%s %d.%09u\n", array->header.frame_id, (int)array->header.stamp.sec,
              (unsigned)array->header.stamp.nanosec);
      for (unsigned n = 0; n < array->poses._length; ++n) {
        const geometry_msgs_msg_dds__Pose_* pose = &array->poses._buffer[n];
        fprintf(out, "%.17g %.17g %.17g %.17g %.17g %.17g %.17g\n", pose->position.x, pose->position.y,
                pose->position.z, pose->orientation.x, pose->orientation.y, pose->orientation.z, pose->orientation.w);
      }
    }
    dds_return_loan(reader, &sample, 1);
    sample = NULL;
  }
  fclose(out);
}

int main(int argc, char** argv) {
  FILE* file = fopen(word(argc, argv, "commands", ""), "r");
  if (file == NULL) {
    perror("commands");
    return 1;
  }
  const double rate = atof(word(argc, argv, "rate", "10"));
  const dds_entity_t participant =
      dds_create_participant((dds_domainid_t)atol(word(argc, argv, "domain", "0")), NULL, NULL);
  check(participant, "participant");
  dds_qos_t* qos = dds_create_qos();
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_SECS(10));
  dds_qset_history(qos, DDS_HISTORY_KEEP_ALL, 0);
  const dds_entity_t to =
      dds_create_topic(participant, &std_msgs_msg_dds__String__desc, "rt/accessvdb/command", NULL, NULL);
  const dds_entity_t from =
      dds_create_topic(participant, &std_msgs_msg_dds__String__desc, "rt/accessvdb/status", NULL, NULL);
  check(to, "topic");
  check(from, "topic");
  const dds_entity_t writer = dds_create_writer(participant, to, qos, NULL);
  const dds_entity_t status = dds_create_reader(participant, from, qos, NULL);
  check(writer, "writer");
  check(status, "reader");
  char poses_topic[64];
  snprintf(poses_topic, sizeof poses_topic, "rt/accessvdb/%s", word(argc, argv, "poses_of", "approaches"));
  const dds_entity_t proposals =
      dds_create_topic(participant, &geometry_msgs_msg_dds__PoseArray__desc, poses_topic, NULL, NULL);
  check(proposals, "topic");
  const dds_entity_t poses = dds_create_reader(participant, proposals, qos, NULL);
  check(poses, "reader");
  dds_publication_matched_status_t matched;
  for (int tries = 0; tries < 1500; ++tries) {
    check(dds_get_publication_matched_status(writer, &matched), "matched");
    if (matched.current_count > 0) break;
    dds_sleepfor(DDS_MSECS(20));
  }
  if (matched.current_count == 0) {
    fprintf(stderr, "live_command_peer: nobody to command after 30 s\n");
    return 1;
  }
  dds_sleepfor(DDS_MSECS(1500));
  listenFor(status, 0, (dds_duration_t)(1e9 * atof(word(argc, argv, "pause_s", "0"))));

  char *line = malloc(kMostLine), *command = malloc(kMostLine);
  int sent = 0;
  while (sent < kMostCommands && fgets(line, kMostLine, file) != NULL) {
    line[strcspn(line, "\n")] = '\0';
    char* id = strstr(line, "%d");
    if (id != NULL) {
      *id = '\0';
      snprintf(command, kMostLine, "%s%d%s", line, sent, id + 2);
    } else {
      strcpy(command, line);
    }
    Text text = {command};
    check(dds_write(writer, &text), "write");
    sent_at[sent++] = dds_time();
    listenFor(status, sent, (dds_duration_t)(1e9 / rate));
  }
  listenFor(status, sent, (dds_duration_t)(1e9 * atof(word(argc, argv, "wait_s", "3"))));
  FILE* out = fopen(word(argc, argv, "answers", ""), "w");
  if (out == NULL) {
    perror("answers");
    return 1;
  }
  int answered = 0;
  for (int n = 0; n < sent; ++n) {
    if (answers[n] == NULL) continue;
    ++answered;
    fprintf(out, "%d %.1f %s\n", n, (double)(answered_at[n] - sent_at[n]) / 1e6, answers[n]);
  }
  fclose(out);
  const char* const poses_file = word(argc, argv, "poses", "");
  if (poses_file[0] != '\0') writePoses(poses, poses_file);
  printf("sent %d, answered %d\n", sent, answered);
  check(dds_delete(participant), "end");
  return 0;
}
