/* Copyright Contributors to the AccessVDB project
 * SPDX-License-Identifier: Apache-2.0
 *
 * Programs that come and go on the topics of a map, and say nothing: some end as they should, some are killed.
 *
 *   live_crowd_peer domain=N at_once=N seconds=S
 *
 * Prints "came N, killed N". */
#include <dds/dds.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "garbage_messages.h"

static double number(int argc, char** argv, const char* name, double otherwise) {
  const size_t length = strlen(name);
  for (int i = 1; i < argc; ++i)
    if (strncmp(argv[i], name, length) == 0 && argv[i][length] == '=') return atof(argv[i] + length + 1);
  return otherwise;
}

static void sleepMs(long ms) {
  const struct timespec time = {ms / 1000, ms % 1000 * 1000000};
  nanosleep(&time, NULL);
}

/* One of them. Every third is killed, every other third only listens to one of the two. */
static int visit(dds_domainid_t domain, long which) {
  const dds_entity_t participant = dds_create_participant(domain, NULL, NULL);
  if (participant < 0) return 1;
  const dds_entity_t clouds =
      dds_create_topic(participant, &sensor_msgs_msg_dds__PointCloud2__desc, "rt/livox/lidar", NULL, NULL);
  const dds_entity_t odometry =
      dds_create_topic(participant, &nav_msgs_msg_dds__Odometry__desc, "rt/Odometry", NULL, NULL);
  const dds_entity_t labels =
      dds_create_topic(participant, &sensor_msgs_msg_dds__PointCloud2__desc, "rt/accessvdb/points", NULL, NULL);
  if (which % 3 == 1) {
    dds_create_reader(participant, labels, NULL, NULL);
  } else {
    dds_create_writer(participant, clouds, NULL, NULL);
    dds_create_writer(participant, odometry, NULL, NULL);
  }
  sleepMs(500 + 37 * which % 1500);
  if (which % 3 == 0) raise(SIGKILL);
  dds_delete(participant);
  return 0;
}

int main(int argc, char** argv) {
  const dds_domainid_t domain = (dds_domainid_t)number(argc, argv, "domain", 0);
  const long at_once = (long)number(argc, argv, "at_once", 50);
  const time_t end = time(NULL) + (time_t)number(argc, argv, "seconds", 5);
  long came = 0, killed = 0, here = 0;
  while (here > 0 || time(NULL) < end) {
    while (here < at_once && time(NULL) < end) {
      const pid_t child = fork();
      if (child < 0) return 1;
      if (child == 0) _exit(visit(domain, came));
      ++came, ++here;
      sleepMs(10);
    }
    int status = 0;
    if (here > 0 && wait(&status) > 0) {
      --here;
      killed += WIFSIGNALED(status);
      if (WIFEXITED(status) && WEXITSTATUS(status) != 0) fprintf(stderr, "live_crowd_peer: one did not get in\n");
    }
  }
  printf("came %ld, killed %ld\n", came, killed);
  return 0;
}
