"""Programs that drive a robot for a while, and then end in one way or another.

Each line "udp://127.0.0.1:PORT WAY" on stdin starts one (a fork, which saves the imports). Just
before it ends it prints its address, its process id and the time.
"""

import ctypes
import os
import sys
import time

from pypose_lite import go1


def raise_an_error(robot):
    raise RuntimeError("the planner has a bug")


def leave_without_closing(robot):
    os.environ["LEFT"] = str(robot.address)  # falls off the end of the program


def exit_at_once(robot):
    os._exit(1)


def crash(robot):
    ctypes.string_at(0)


def sleep(robot):
    time.sleep(60)


def spin(robot):
    while True:
        pass


def hold_the_interpreter(robot):
    sum(range(10**12))  # one call of a C function: no other thread runs


def keep_driving(robot):
    while True:
        robot.move(0.4, 0.3)
        robot.wait(0.1)


def swallow_everything(robot):
    while True:
        try:
            keep_driving(robot)
        except BaseException:
            time.sleep(60)


def watch_the_state(robot):
    for _ in range(300):
        try:
            print(time.monotonic(), robot.state.position[0], flush=True)
        except go1.RobotTimeout:
            pass
        time.sleep(0.01)
    print("end", flush=True)


def drive(address, way):
    robot = go1.connect(address)
    inside = way != "leave_without_closing"
    try:
        for _ in range(5):
            robot.move(0.4, 0.3)
            robot.wait(0.1)
        robot.move(0.4, 0.3)
        print(address, os.getpid(), time.monotonic(), flush=True)
        globals()[way](robot)
    finally:
        if inside:
            robot.close()


if __name__ == "__main__":
    while line := sys.stdin.readline():
        if os.fork() == 0:
            drive(*line.split())
            break
