"""A robot played by the vendor's server class: it hears commands by the vendor's own rules.

    python vendor_robot.py PORT

Its Python build cannot send a state, so the states go out through its socket from here. It prints
how many datagrams it accepted when stdin is closed.
"""

import json
import os
import socket
import sys
import threading

from unitree_legged_sdk import robot_interface as sdk

from pypose_lite.go1.wire.protocol import (
    COMMAND_SIZE,
    STATE_SIZE,
    BmsState,
    HighState,
    encode_state,
)


def sockets():
    """The file descriptors of this process that are sockets."""
    links = ((int(n), f"/proc/self/fd/{n}") for n in os.listdir("/proc/self/fd"))
    return {n for n, link in links if os.path.exists(link) and "socket" in os.readlink(link)}


before = sockets()
udp = sdk.UDP(int(sys.argv[1]), STATE_SIZE, COMMAND_SIZE, False, sdk.RecvEnum.nonBlock, False)
(number,) = sockets() - before
ear = socket.socket(fileno=os.dup(number))
print("READY", flush=True)
ended = threading.Event()
threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
answers, client, tick = [], None, 0
while not ended.wait(0.002):
    if client is None:  # who speaks is seen by a look that leaves the datagram where it is
        try:
            _, client = ear.recvfrom(1, socket.MSG_PEEK | socket.MSG_DONTWAIT)
        except BlockingIOError:
            continue
    answers.append(udp.Recv())
    tick += 1
    place = 1.0 + 0.001 * tick, -2.0, 0.28
    state = HighState(position=place, mode=2, body_height=0.28, bms=BmsState(soc=80))
    ear.sendto(encode_state(state), client)
heard = [answer for answer in answers if answer not in (-1, -4)]  # those are "nothing came"
print("REPORT", json.dumps({"accepted": heard.count(0), "heard": len(heard)}), flush=True)
