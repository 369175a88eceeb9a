"""User of a connection, from the kernel's table of TCP connections."""

from __future__ import annotations

import os
import socket
import sys

import pytest

from arena.monitor.peer import peer_uid, uid_in

TABLE = """\
  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode
   0: 0100007F:2120 00000000:0000 0A 00000000:00000000 00:00000000 00000000  1000        0 4321 1 0000 100 0 0 10 0
   1: 0100007F:2120 0100007F:D431 01 00000000:00000000 00:00000000 00000000  1000        0 4322 1 0000 20 4 30 10 -1
   2: 0100007F:D431 0100007F:2120 01 00000000:00000000 00:00000000 00000000  1001        0 4323 1 0000 20 4 30 10 -1
"""


@pytest.mark.skipif(sys.byteorder != "little", reason="the table is that of a little-endian machine")
def test_user_is_that_of_the_clients_end():
    client, server = ("127.0.0.1", 0xD431), ("127.0.0.1", 0x2120)
    assert uid_in(TABLE, client, server) == 1001
    assert uid_in(TABLE, server, client) == 1000
    assert uid_in(TABLE, ("127.0.0.2", 0xD431), server) is None


@pytest.mark.parametrize("host", ["127.0.0.1", "::1"])
def test_user_of_a_real_connection_is_found(host):
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.create_server((host, 0), family=family) as server:
        client = socket.create_connection(server.getsockname()[:2], timeout=20)
        accepted, address = server.accept()
        with client, accepted:
            assert peer_uid(address[:2], accepted.getsockname()[:2]) == os.getuid()


def test_system_without_the_table_knows_no_user(tmp_path):
    assert peer_uid(("127.0.0.1", 1), ("127.0.0.1", 2), tmp_path) is None
