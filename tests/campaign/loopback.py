# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""DDS on this machine alone, as in tests/live/dds_world.h."""
import fcntl
import os
import pathlib
import tempfile

# Cyclone DDS on loopback, which often has no multicast: it asks the first participants one by one.
CYCLONE = ("<CycloneDDS><Domain><General><Interfaces><NetworkInterface address=\"127.0.0.1\" multicast=\"false\"/>"
           "</Interfaces><AllowMulticast>false</AllowMulticast><MaxMessageSize>65500B</MaxMessageSize></General>"
           "<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>30</MaxAutoParticipantIndex>"
           "<Peers><Peer address=\"127.0.0.1\"/></Peers></Discovery></Domain></CycloneDDS>")


def environment():
    return {**os.environ, "CYCLONEDDS_URI": CYCLONE}


class OwnDomain:
    """A domain that no other test on this machine uses, in a `with`."""

    def __enter__(self):
        for tries in range(90):
            number = 10 + (os.getpid() + tries) % 90
            lock = os.open(pathlib.Path(tempfile.gettempdir()) / f"accessvdb_dds_{number}",
                           os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o666)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                os.close(lock)
                continue
            self.lock, self.number = lock, number
            return number
        raise RuntimeError("all domains of DDS are taken")

    def __exit__(self, *_):
        os.close(self.lock)
