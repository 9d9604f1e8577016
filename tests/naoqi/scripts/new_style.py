import argparse
import sys
import time

import qi


def main(session):
    motion = session.service("ALMotion")
    future = motion.moveTo(0.2, 0.0, 0.0, _async=True)
    while motion.moveIsActive():
        pass
    print("arrived", future.value())
    begun = time.time()
    time.sleep(1.0)
    print("slept", round(time.time() - begun, 1))
    memory = session.service("ALMemory")
    subscriber = memory.subscriber("Own")
    subscriber.signal.connect(lambda value: print("event", value))
    memory.raiseEvent("Own", 5)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--ip", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=9559)
    args = parser.parse_args()
    session = qi.Session()
    try:
        session.connect("tcp://" + args.ip + ":" + str(args.port))
    except RuntimeError:
        sys.exit(1)
    main(session)
