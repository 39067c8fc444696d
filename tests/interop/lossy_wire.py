"""A wire that loses and delays: two TAP interfaces, and every frame of one comes out of the other, or not. What `tc netem`
does in a kernel that has it. Usage: lossy_wire.py NAME1 NAME2 LOSS DELAY [unicast]. A line `LOSS DELAY` on stdin changes both; a
loss of 1 interrupts the network. With `unicast`, multicast is lost. Ends with its stdin."""

import fcntl
import heapq
import os
import random
import select
import struct
import sys
import time

TUNSETIFF, IFF_TAP, IFF_NO_PI = 0x400454CA, 0x0002, 0x1000


def tap(name):
    file = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(file, TUNSETIFF, struct.pack("16sH", name.encode(), IFF_TAP | IFF_NO_PI))
    return file


ends = [tap(sys.argv[1]), tap(sys.argv[2])]
loss, delay = float(sys.argv[3]), float(sys.argv[4])
unicast = sys.argv[5:] == ["unicast"]
print("ready", flush=True)
luck = random.Random(1)
# Due time, number, where to, frame.
waiting, count = [], 0
while True:
    patience = max(0.0, waiting[0][0] - time.monotonic()) if waiting else None
    readable, _, _ = select.select([*ends, sys.stdin], [], [], patience)
    if sys.stdin in readable:
        line = sys.stdin.readline()
        if not line:
            break
        loss, delay = map(float, line.split())
        readable.remove(sys.stdin)
    for end in readable:
        try:
            frame = os.read(end, 65536)
        except OSError:  # not up yet
            continue
        count += 1
        if unicast and frame[0] & 1 and frame[0] != 0xFF:
            continue
        if luck.random() >= loss:
            other = ends[1 - ends.index(end)]
            heapq.heappush(waiting, (time.monotonic() + delay, count, other, frame))
    while waiting and waiting[0][0] <= time.monotonic():
        _, _, other, frame = heapq.heappop(waiting)
        try:
            os.write(other, frame)
        except OSError:  # the other end is not up: lost
            pass
