"""The vendor's client, walking a robot for two seconds; prints what it was told of its state.

python vendor_client.py PORT_OF_THE_ROBOT OWN_PORT
"""

import json
import sys
import time

from unitree_legged_sdk import robot_interface as sdk

port, own_port = map(int, sys.argv[1:])
udp = sdk.UDP(0xEE, own_port, "127.0.0.1", port)
command, state, answers = sdk.HighCmd(), sdk.HighState(), []
udp.InitCmdData(command)
for tick in range(200):
    command.mode, command.gaitType = 2, 1
    command.velocity, command.yawSpeed = [0.3, 0.0], 0.5
    udp.SetSend(command)
    udp.Send()
    time.sleep(0.01)
    answers.append(udp.Recv())
    udp.GetRecv(state)
    if tick == 20:
        first = list(state.position)
report = {
    "accepted": answers.count(0),
    "first_position": first,
    "position": list(state.position),
    "velocity": list(state.velocity),
    "yaw_speed": state.yawSpeed,
    "mode": state.mode,
    "gait_type": state.gaitType,
    "body_height": state.bodyHeight,
    "soc": state.bms.SOC,
    "rpy": list(state.imu.rpy),
    "quaternion": list(state.imu.quaternion),
}
print("REPORT", json.dumps(report), flush=True)
