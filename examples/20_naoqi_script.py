"""What a NAOqi script does, on the twin: speech with a gesture, joints, a way that a wall ends."""

import numpy as np

import pepper_kin as pk
from pepper_kin.naoqi import Broker, RunLog

scene = pk.Scene().add_box("wall", size=(0.1, 2.0, 1.0), position=(1.5, 0.0, 0.5))
with Broker(real_time=False, scene=scene) as broker:
    motion, memory = broker.motion, broker.memory
    log = RunLog(broker.body)

    motion.wakeUp()
    broker.module("ALAnimatedSpeech").say("^start(animations/Stand/Gestures/Hey_1) Hello, I am a twin")
    motion.angleInterpolation(["HeadYaw", "HeadPitch"], [[0.4, 0.0], [-0.2, -0.1]], [[0.8, 1.6]] * 2, True)
    commanded, measured = (np.array(motion.getAngles("Joints", sensors)) for sensors in (False, True))
    print(f"largest error at rest: {1000 * np.abs(commanded - measured).max():.2f} mrad")

    arrived = motion.moveTo(2.0, 0.0, 0.0)
    distance = memory.getData("Device/SubDeviceList/Platform/Front/Sonar/Sensor/Value")
    print(f"arrived: {arrived}; the front sonar reads {distance:.2f} m")
    run = log.run()
print(run.report())

assert not arrived
assert distance > 0.4
assert np.abs(commanded - measured).max() < 2e-3
