"""Modules besides ALMotion, and the table of methods."""

import csv
import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.naoqi import Broker, NaoqiError, NotSimulatedError, coverage, coverage_summary
from pepper_kin.naoqi.kept_states import RefusedModule, StateModule
from pepper_kin.naoqi.module import robot_signatures

ROOT = Path(__file__).parents[2]


def test_every_method_of_the_robots_list_is_answered(broker):
    text = (ROOT / "pepper_kin/naoqi/data/signatures.csv").read_text("utf-8")
    rows = list(csv.DictReader(text.splitlines()))
    assert len(rows) == len(robot_signatures())
    refused = []
    for row in rows:
        method = getattr(broker.module(row["module"]), row["name"])
        assert callable(method)
        if method.__name__ == "refuse":
            count = len([p for p in row["parameters"].split(", ") if p])
            with pytest.raises(NotSimulatedError, match=row["name"]):
                method(*[0] * count)
            refused.append((row["module"], row["name"]))
    table = coverage()
    named = {(row.module, row.method) for row in table if row.answer.startswith("refused by name: ")}
    assert named.issuperset(refused)
    assert len(refused) <= 0.05 * len(rows)


def test_each_row_of_the_table_is_what_the_module_does(broker):
    assert {row.module for row in coverage()} <= set(broker.module_names)
    for module, name, answer in coverage():
        method = getattr(broker.module(module), name)
        assert callable(method)
        assert (method.__name__ == "refuse") == answer.startswith("refused by name: ")
        if method.__name__ == "refuse":
            with pytest.raises(NotSimulatedError, match=re.escape(answer.partition(": ")[2])):
                method()


def test_the_table_in_the_docs_is_the_table():
    assert coverage_summary() in (ROOT / "docs/naoqi.md").read_text("utf-8")


def test_every_row_of_the_simple_methods_is_a_method_that_keeps_what_is_set(broker):
    text = (ROOT / "pepper_kin/naoqi/data/simple_methods.csv").read_text("utf-8")
    rows = list(csv.DictReader(text.splitlines()))
    kept = {}
    for row in rows:
        module = broker.module("ALMotion" if row["module"] == "ALModule" else row["module"])
        assert row["method"] in module.getMethodList()
        assert module.getMethodHelp(row["method"]) == row["doc"]
        if row["does"] == "call":
            assert callable(getattr(type(module), row["place"]))
        if row["does"] in ("set", "confirm"):
            kept[row["module"], row["place"]] = row
    for row in rows:
        setter = kept.get((row["module"], row["place"])) if row["does"] == "get" else None
        if setter is not None:
            module, key = broker.module(row["module"]), ["x"] * row["parameters"].count(";")
            key += ["x"] if row["parameters"] else []
            value = {"bool": False, "str": "other", "number": 0.25, "any": [1], "int": 7}[setter["value"]]
            answer = getattr(module, setter["method"])(*key, value)
            assert answer is (True if setter["does"] == "confirm" else None)
            assert getattr(module, row["method"])(*key) == value


def test_memory_keeps_data_and_calls_subscribers(broker):
    memory, got = broker.memory, []
    memory.insertData("a/b", [1, "two"])
    assert memory.getData("a/b") == [1, "two"]
    number = memory.subscriber("Happened").signal.connect(got.append)
    memory.raiseEvent("Happened", 3)
    memory.subscriber("Happened").signal.disconnect(number)
    memory.raiseEvent("Happened", 4)
    assert got == [3]
    assert memory.getEventHistory("Happened") == [3, 4]
    with pytest.raises(NaoqiError, match="unable to get data for key: nothing"):
        memory.getData("nothing")


def test_device_keys_are_the_body(broker, motion):
    motion.setAngles("HeadYaw", 0.4, 0.5)
    broker.body.time.sleep(1.5)
    memory = broker.memory
    at = "Device/SubDeviceList/HeadYaw/Position"
    assert memory.getData(f"{at}/Actuator/Value") == pytest.approx(0.4)
    assert memory.getListData([f"{at}/Sensor/Value", "none"])[0] == pytest.approx(0.4, abs=1e-3)
    down = memory.getData("Device/SubDeviceList/InertialSensor/AccelerometerZ/Sensor/Value")
    assert down == pytest.approx(9.81, abs=0.05)
    for key in memory.getDataList("Device/SubDeviceList"):
        assert memory.getData(key) is not None


def test_lasers_and_sonars_see_the_scene():
    scene = pk.Scene().add_box("wall", size=(0.1, 3.0, 2.0), position=(1.05, 0.0, 1.0))
    with Broker(real_time=False, scene=scene) as broker:
        x = broker.memory.getData(
            "Device/SubDeviceList/Platform/LaserSensor/Front/Horizontal/Seg08/X/Sensor/Value"
        )
        origin = broker.motion.getPosition("LaserSensor/Front", 2, True)[0]
        assert x + origin == pytest.approx(1.0, abs=1e-6)
        sonar = broker.memory.getData("Device/SubDeviceList/Platform/Front/Sonar/Sensor/Value")
        assert 0.8 < sonar < 1.0


def test_a_press_is_an_event(broker):
    got = []
    assert broker.memory.getData("MiddleTactilTouched") == 0.0
    broker.memory.subscriber("MiddleTactilTouched").signal.connect(got.append)
    broker.memory.press("head_touch_middle", True)
    assert broker.memory.getData("Device/SubDeviceList/Head/Touch/Middle/Sensor/Value") == 1.0
    broker.memory.press("head_touch_middle", False)
    assert got == [1.0, 0.0]


def test_postures_are_reached_and_named(broker):
    posture = broker.module("ALRobotPosture")
    assert posture.goToPosture("Crouch", 0.6) is True
    assert posture.getPosture() == "Crouch"
    assert posture.goToPosture("StandZero", 0.6) is True
    assert broker.motion.getAngles("Joints", False) == pytest.approx([0.0] * 15, abs=0.05)
    assert posture.goToPosture("Sit", 0.5) is False
    with pytest.raises(NaoqiError, match="StandZero"):
        posture.goToPosture("Headstand", 0.5)


def test_waking_and_resting(broker, motion):
    motion.rest()
    assert not motion.robotIsWakeUp()
    assert motion.getStiffnesses("LArm") == [0.0] * 6
    motion.wakeUp()
    assert motion.robotIsWakeUp()
    assert motion.getStiffnesses("LArm") == [1.0] * 6
    assert broker.module("ALRobotPosture").getPosture() == "Stand"


def test_pictures_of_clients_at_the_same_time_are_their_own(broker):
    video, body = broker.module("ALVideoDevice"), broker.body
    names, spaces = {0: "camera_top", 1: "camera_bottom"}, {11: slice(None), 13: slice(None, None, -1)}
    handles = {(k, s): video.subscribeCamera("test", k, 1, s, 10) for k in names for s in spaces}
    cameras = {k: pk.twin.sensors.Camera(body.pepper, name) for k, name in names.items()}
    for turn in (0.0, 0.5, -0.4):
        broker.motion.setAngles("HeadYaw", turn, 0.5)
        body.time.sleep(1.0)
        expected = {k: camera.color(body.configuration(True)) for k, camera in cameras.items()}
        with ThreadPoolExecutor(8) as pool:
            asked = list(handles) * 4
            found = list(pool.map(lambda key: video.getImageRemote(handles[key])[6], asked))
        for (camera, space), data in zip(asked, found, strict=True):
            assert data == expected[camera][..., spaces[space]].tobytes()


def test_pictures_are_those_of_the_twins_camera(broker):
    video = broker.module("ALVideoDevice")
    handle = video.subscribeCamera("test", 0, 1, 11, 10)
    width, height, layers, space, _, _, data, camera, *angles = video.getImageRemote(handle)
    assert (width, height, layers, space, camera) == (320, 240, 3, 11, 0)
    pixels = np.frombuffer(data, np.uint8).reshape(240, 320, 3)
    body = broker.body
    expected = pk.twin.sensors.Camera(body.pepper, "camera_top").color(body.configuration(True))
    assert np.array_equal(pixels, expected)
    assert angles[0] == -angles[2] == pytest.approx(0.48, abs=0.05)
    deep = video.getImageRemote(video.subscribeCamera("test", 2, 1, 17, 10))
    millimeters = np.frombuffer(deep[6], "<u2").reshape(240, 320)
    assert 4000 < millimeters[235, 160] < 5000  # the floor
    assert millimeters[200, 160] == 0  # beyond the camera's range
    gray = video.getImageRemote(video.subscribeCamera("test", 1, 0, 0, 10))
    assert len(gray[6]) == 160 * 120
    assert video.unsubscribe(handle)
    with pytest.raises(NaoqiError, match="is no subscription"):
        video.getImageRemote(handle)


def test_a_subscription_to_several_cameras_has_settings_and_pictures_of_each(broker):
    video = broker.module("ALVideoDevice")
    handle = video.subscribeCameras("test", [0, 2], [1, 0], [11, 17], 10)
    assert (video.getActiveCameras(handle), video.getResolutions(handle)) == ([0, 2], [1, 0])
    assert video.setResolutions(handle, [8, 7]) == video.releaseImages(handle) == [True, True]
    images = video.getImagesRemote(handle)
    assert [(image[0], image[1], image[7]) for image in images] == [(40, 30, 0), (80, 60, 2)]
    raw = video.getDirectRawImagesRemote(handle)
    assert [(image[3], len(image[6])) for image in raw] == [(9, 40 * 30 * 2), (17, 80 * 60 * 2)]
    assert video.getColorSpaces(handle) == [11, 17]
    assert video.setCamerasParameter(handle, 35, [1, 1]) == [True, True]
    assert video.setCamerasParameterToDefault(handle, 35) == [True, True]
    assert video.getCamerasParameter(handle, 35) == [0, 0]
    assert video.isCameraStarted(2)
    assert not video.isCameraStarted(1)
    assert video.setActiveCamera(handle, 1)
    assert video.getActiveCamera(handle) == 1
    assert video.getResolution(1) == 8
    with pytest.raises(NaoqiError, match="as many resolutions"):
        video.subscribeCameras("test", [0, 2], [1], [11, 17], 10)


def test_parameters_of_cameras_have_the_documented_ranges_and_are_kept(broker):
    video = broker.module("ALVideoDevice")
    handle = video.subscribeCamera("test", 1, 1, 11, 10)
    assert set(video.getParameterList(1)) == set(video.getCameraParameterList(handle)) >= {0, 1, 2, 3, 11, 12}
    assert video.getParameterRange(1, 3) == [-180, 180]
    assert video.getParameter(1, 1) == 32
    assert video.setCameraParameter(handle, 1, 40)
    assert video.getParam(1, 1) == video.getCameraParameter(handle, 1) == 40
    assert video.setParameterToDefault(1, 1)
    assert video.getParameter(1, 1) == 32
    assert video.setParam(18, 1)
    assert (video.getActiveCamera(), video.getCameraModelID(), video.getCameraModel(2)) == (1, 3, 4)
    with pytest.raises(NaoqiError, match="parameter: got 99"):
        video.getParameterRange(1, 99)


def test_angles_and_sizes_in_pictures_come_back(broker):
    video = broker.module("ALVideoDevice")
    for camera in (0, 1, 2):
        corner = video.getAngularPositionFromImagePosition(camera, [0.0, 1.0])
        assert corner == pytest.approx([video.getHorizontalFOV(camera) / 2, video.getVerticalFOV(camera) / 2])
        angles = video.getAngularSizeFromImageSize(camera, [0.3, 0.2])
        assert video.getImageSizeFromAngularSize(camera, angles) == pytest.approx([0.3, 0.2])
        pixels = video.getImageInfoFromAngularInfoWithResolution(camera, [0.0, 0.0, *angles], 2)
        assert pixels == pytest.approx([320.0, 240.0, 192.0, 96.0])
    right, bottom = video.getImageRemote(video.subscribeCamera("test", 0, 8, 0, 10))[8:10]
    assert (video.getHorizontalFOV(0), video.getVerticalFOV(0)) == pytest.approx((2 * right, 2 * bottom))
    assert video.getAngPosFromImgPos([0.5, 0.5]) == [0.0, 0.0]
    assert video.resolutionToSizes(2) == [640, 480]
    assert (video.sizesToResolution(320, 240), video.sizesToResolution(3, 4)) == (1, -1)


def test_free_zones_end_at_obstacles():
    scene = pk.Scene().add_box("wall", size=(0.1, 2.0, 1.0), position=(1.0, 0.0, 0.5))
    with Broker(real_time=False, scene=scene) as broker:
        navigation = broker.module("ALNavigation")
        assert navigation.findFreeZone(0.6, 1.0) == [0, 0.6, [0.0, 0.0]]
        failed, radius, place = navigation.getFreeZone(2.0, 1.0)
        assert (failed, place) == (1, [0.0, 0.0])
        assert radius == pytest.approx(0.95, abs=0.05)


def test_ears_show_a_direction(broker):
    leds = broker.module("ALLeds")
    leds.earLedsSetAngle(180, 0.5, True)
    assert [light for light in leds.listLED("EarLeds") if leds.color(light)[2] > 0.0] == [
        "LeftEarLed6",
        "RightEarLed6",
    ]
    leds.earLedsSetAngle(90, 0.5, False)
    assert all(leds.color(light)[2] == 0.0 for light in leds.listLED("EarLeds"))
    assert broker.body.time.now == pytest.approx(1.0, abs=0.05)


def test_the_tracker_knows_its_old_names(broker):
    tracker = broker.module("ALTracker")
    tracker.addTarget("Face", 0.1)
    tracker.setTargetCoordinates([-0.5, 0.0, 0.0, 0.1, 0.1, 0.3])
    assert tracker.getRelativePosition() == tracker.getTargetCoordinates() == [-0.5, 0.0, 0.0, 0.1, 0.1, 0.3]
    tracker.place_target("Face", [1.5, 0.3, 1.2])
    tracker.track("Face")
    assert tracker.getTargetPosition() == tracker.getTargetPosition(0)
    tracker.addEffector("LArm")
    assert (tracker.getEffector(), tracker.getManagedTargets()) == ("LArm", ["Face"])
    tracker.removeEffector("LArm")
    tracker.removeTarget("Face")
    assert (tracker.getEffector(), tracker.getRegisteredTargets()) == ("None", [])
    tracker.setExtractorPeriod("Face", 200)
    assert (tracker.getExtractorPeriod("Face"), tracker.getExtractorPeriod("People")) == (200, 20)


def test_speech_takes_its_time_and_moves_the_body(broker):
    speech = broker.module("ALTextToSpeech")
    begun = broker.body.time.now
    speech.say("\\pau=500\\ " + "a" * 50)
    assert broker.body.time.now - begun == pytest.approx(0.5 + 50 * 0.06, abs=0.04)
    before = np.array(broker.motion.getAngles("RArm", False))
    moved = []
    broker.body.listeners.append(lambda: moved.append(broker.motion.getAngles("RArm", False)))
    broker.module("ALAnimatedSpeech").say(
        "^start(animations/Stand/Gestures/Hey_1) Hello to everybody in this place"
    )
    assert np.abs(np.array(moved) - before).max() > 0.5
    assert [spoken.text for spoken in speech.spoken][-1] == "Hello to everybody in this place"


def test_animations_are_gestures_of_the_library(broker):
    player = broker.module("ALAnimationPlayer")
    begun = broker.body.time.now
    player.run("animations/Stand/Gestures/Yes_1")
    yes = pk.motion.gesture(pk.load_pepper(), "yes").duration
    assert broker.body.time.now - begun == pytest.approx(yes, abs=1.0)
    with pytest.raises(NaoqiError, match="expected one of"):
        player.runTag("no such tag")


def test_lights_fade(broker):
    leds = broker.module("ALLeds")
    leds.fadeRGB("FaceLeds", "red", 1.0)
    assert leds.color("LeftFaceLed0") == pytest.approx((1.0, 0.0, 0.0))
    leds.fadeRGB("ChestLeds", 0x0000FF, 0.0)
    assert leds.color("ChestLeds") == (0.0, 0.0, 1.0)
    leds.off("AllLeds")
    assert leds.getIntensity("EarLeds") == [0.0] * 20


def test_modules_that_are_not_simulated_say_so(broker):
    for module, method, why in (
        ("ALRecharge", "goToStation", "no charging station"),
        ("ALPhotoCapture", "takePicture", "pictures come from ALVideoDevice"),
        ("ALVideoDevice", "recordVideo", "nothing that it could act on"),
        ("ALDialog", "addFallback", "nothing that it could act on"),
        ("DCM", "createAlias", "ALMotion"),
    ):
        with pytest.raises(NotSimulatedError, match=f"{module}::{method}\n\tis not simulated: .*{why}"):
            getattr(broker.module(module), method)()


def test_absent_senses_keep_their_settings_and_sense_nothing(broker):
    hearing, dialog = broker.module("ALSpeechRecognition"), broker.module("ALDialog")
    hearing.pause(True)
    hearing.setVocabulary(["yes", "no"], False)
    hearing.setLanguage("French")
    dialog.setLanguage("German")
    for module in ("ALSpeechRecognition", "ALDialog", "ALFaceDetection", "ALMood", "ALTactileGesture"):
        broker.module(module).subscribe("own")
        broker.module(module).unsubscribe("own")
    assert (hearing.getLanguage(), dialog.getLanguage()) == ("French", "German")
    assert (dialog.getActivatedTopics(), broker.module("ALUserSession").getFocusedUser()) == ([], -1)
    memory = broker.memory
    assert [memory.getData(key) for key in ("FaceDetected", "LandmarkDetected", "WordRecognized")] == [
        [],
        [],
        ["", 0.0],
    ]
    memory.getData("FaceDetected").append(1)
    assert memory.getData("FaceDetected") == []
    memory.raiseEvent("FaceDetected", [1])
    assert memory.getData("FaceDetected") == [1]


def test_methods_that_no_robot_has_are_refused_in_one_line_and_not_there(broker):
    for module in map(broker.module, broker.module_names):
        if isinstance(module, RefusedModule | StateModule):
            continue  # which answer to any name
        assert not hasattr(module, "setAngels")
        with pytest.raises(RuntimeError, match=rf"^{module.name}::setAngels: no such method") as caught:
            module.setAngels(1)
        assert "\n" not in str(caught.value)
    with pytest.raises(RuntimeError, match=r"did you mean setAngles"):
        broker.motion.setAngels("HeadYaw", 0.1, 0.2)


def test_touches_have_the_names_of_the_devices(broker):
    touch, told = broker.module("ALTouch"), []
    broker.memory.subscriber("TouchChanged").signal.connect(told.append)
    assert {"Head/Touch/Middle", "LHand/Touch/Back", "Platform/Back/Bumper"} <= set(touch.getSensorList())
    broker.memory.press("head_touch_middle", True)
    assert [name for name, touched, _ in touch.getStatus() if touched] == ["Head/Touch/Middle"]
    assert told == [[["Head/Touch/Middle", True, []]]]
