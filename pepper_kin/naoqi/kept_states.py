"""Modules of which the twin keeps what was set: movements by themselves, extractors, sound, the tablet."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pepper_kin.naoqi.errors import NotSimulatedError
from pepper_kin.naoqi.memory import Signal
from pepper_kin.naoqi.module import Module


class StateModule(Module):
    """A module whose `set...` and `get...` keep values, and whose other listed methods are accepted.

    Its `set` and `get` methods are made as they are called, so that what was set comes back.
    """

    accepted: tuple[str, ...] = ()
    defaults: dict[str, Any] = {}  # noqa: RUF012

    def __init__(self, broker: Any) -> None:
        super().__init__(broker)
        self._values: dict[str, Any] = dict(self.defaults)

    def getMethodList(self) -> list[str]:
        """Return the names of all methods that are listed."""
        kept = [f"{prefix}{what}" for what in self.defaults for prefix in ("set", "get", "is")]
        return sorted({*super().getMethodList(), *self.accepted, *kept})

    def __getattr__(self, name: str) -> Callable[..., Any]:
        """Return the function of a listed method, or of a `set` or `get`."""
        if name.startswith("_"):
            raise AttributeError(name)
        if name in self.accepted:
            return lambda *values: self._done(name, values)
        for prefix in ("set", "get", "is"):
            what = name[len(prefix) :]
            if name.startswith(prefix) and what[:1].isupper():
                return self._setter(what) if prefix == "set" else self._getter(name, what)
        return super().__getattr__(name)

    def _done(self, name: str, values: tuple[Any, ...]) -> bool:
        self.broker.log(f"{self.name}.{name}({', '.join(map(repr, values))})")
        return True

    def _setter(self, what: str) -> Callable[..., bool]:
        def keep(*values: Any) -> bool:
            *key, value = values or (True,)
            self._values["/".join([what, *map(str, key)])] = value
            return True

        return keep

    def _getter(self, name: str, what: str) -> Callable[..., Any]:
        def read(*key: Any) -> Any:
            place = "/".join([what, *map(str, key)])
            if place not in self._values:
                raise NotSimulatedError(self.name, name, "nobody has set it before")
            return self._values[place]

        return read


def _state_module(name: str, doc: str, accepted: tuple[str, ...] = (), **defaults: Any) -> type[StateModule]:
    return type(
        name, (StateModule,), {"name": name, "__doc__": doc, "accepted": accepted, "defaults": defaults}
    )


SUBSCRIBE = ("subscribe", "unsubscribe", "updatePeriod", "updatePrecision", "pause")

TABLET = (
    "showImage",
    "showImageNoCache",
    "hideImage",
    "preLoadImage",
    "showWebview",
    "loadUrl",
    "loadApplication",
    "hideWebview",
    "reloadPage",
    "playVideo",
    "stopVideo",
    "pauseVideo",
    "resumeVideo",
    "showInputDialog",
    "showInputTextDialog",
    "showAlertView",
    "hideDialog",
    "turnScreenOn",
    "wakeUp",
    "goToSleep",
    "enableWifi",
    "executeJS",
    "cleanWebview",
    "resetTablet",
    "hide",
    "pauseGif",
    "resumeGif",
    "configureWifi",
    "hideAll",
    "resetToDefaultValue",
)


class ALTabletService(_state_module("ALTabletService", "", TABLET, Brightness=1.0, WifiStatus="IDLE")):  # type: ignore[misc]
    """The tablet: what it would show is logged."""

    def __init__(self, broker: Any) -> None:
        super().__init__(broker)
        self.onTouchDown, self.onTouchUp, self.onTouch = Signal(), Signal(), Signal()
        self.onInputText, self.onJSEvent, self.videoFinished = Signal(), Signal(), Signal()

    def robotIp(self) -> str:
        """Return the address of the robot as the tablet knows it."""
        return "198.18.0.1"


STATES = tuple(
    _state_module(name, doc, accepted, **defaults)
    for name, doc, accepted, defaults in (
        (
            "ALAutonomousMoves",
            "Small movements by itself, which the twin does not make.",
            ("startSmallDisplacements", "stopSmallDisplacements"),
            {"ExpressiveListeningEnabled": False, "BackgroundStrategy": "none"},
        ),
        (
            "ALBackgroundMovement",
            "Movements while waiting, which the twin does not make.",
            (),
            {"Enabled": False},
        ),
        (
            "ALListeningMovement",
            "Movements while listening, which the twin does not make.",
            (),
            {"Enabled": False},
        ),
        (
            "ALSpeakingMovement",
            "Movements while speaking.",
            ("addTagsToWords", "resetTagsToWords"),
            {"Enabled": True, "Mode": "contextual"},
        ),
        ("ALAutonomousBlinking", "Blinking of the eyes, which the twin does not do.", (), {"Enabled": False}),
        (
            "ALBodyTemperature",
            "Temperatures of the motors, which stay as they are.",
            (),
            {"TemperatureDiagnosis": None, "EnableNotifications": False},
        ),
        ("ALSonar", "Sonars: their distances stand in ALMemory.", SUBSCRIBE, {}),
        ("ALLaser", "Lasers: their points stand in ALMemory.", (*SUBSCRIBE, "laserON", "laserOFF"), {}),
        ("ALSensors", "Sensors: their values stand in ALMemory.", (*SUBSCRIBE, "run", "pauseExtractors"), {}),
        (
            "ALFaceDetection",
            "Faces: none are detected.",
            (*SUBSCRIBE, "enableTracking", "enableRecognition"),
            {"TrackingEnabled": False, "RecognitionEnabled": False},
        ),
        (
            "ALPeoplePerception",
            "People: none are detected.",
            (*SUBSCRIBE, "resetPopulation"),
            {"MaximumDetectionRange": 3.0, "FastModeEnabled": False},
        ),
        (
            "ALEngagementZones",
            "Zones around the robot, in which nobody is.",
            SUBSCRIBE,
            {"FirstLimitDistance": 1.5, "SecondLimitDistance": 2.5, "LimitAngle": 90.0},
        ),
        ("ALMovementDetection", "Movements: none are detected.", SUBSCRIBE, {}),
        ("ALLandMarkDetection", "Landmarks: none are detected.", SUBSCRIBE, {}),
        ("ALRedBallDetection", "Red balls: none are detected.", SUBSCRIBE, {}),
        ("ALColorBlobDetection", "Blobs: none are detected.", SUBSCRIBE, {}),
        ("ALBarcodeReader", "Barcodes: none are detected.", SUBSCRIBE, {}),
        ("ALGazeAnalysis", "Gazes: none are detected.", SUBSCRIBE, {}),
        (
            "ALFaceCharacteristics",
            "Faces: none are detected.",
            (*SUBSCRIBE, "analyzeFaceCharacteristics"),
            {},
        ),
        ("ALSittingPeopleDetection", "People: none are detected.", SUBSCRIBE, {}),
        ("ALWavingDetection", "Waving: nobody waves.", SUBSCRIBE, {}),
        ("ALSoundDetection", "Sounds: none are heard.", SUBSCRIBE, {}),
        ("ALSoundLocalization", "Sounds: none are heard.", SUBSCRIBE, {}),
        (
            "ALAudioDevice",
            "Loudspeakers and microphones, which are silent.",
            (
                *SUBSCRIBE,
                "muteAudioOut",
                "openAudioInputs",
                "closeAudioInputs",
                "enableEnergyComputation",
                "disableEnergyComputation",
                "startMicrophonesRecording",
                "stopMicrophonesRecording",
                "flushAudioOutputs",
            ),
            {"OutputVolume": 50, "ClientPreferences": None, "AudioOutMuted": False},
        ),
        (
            "ALAudioPlayer",
            "Sounds, which are not heard.",
            (
                "playFile",
                "playFileFromPosition",
                "playFileInLoop",
                "play",
                "playInLoop",
                "loadFile",
                "unloadFile",
                "unloadAllFiles",
                "pause",
                "stopAll",
                "playSoundSetFile",
                "loadSoundSet",
                "playSine",
                "playWebStream",
                "goTo",
            ),
            {"MasterVolume": 1.0, "Volume": 1.0},
        ),
        (
            "ALAudioRecorder",
            "Recordings of sound, which hold nothing.",
            ("startMicrophonesRecording", "stopMicrophonesRecording", "recover"),
            {},
        ),
        ("ALConnectionManager", "Networks: the twin is where it is.", ("scan",), {}),
        (
            "ALResourceManager",
            "Resources: all are free.",
            (
                "acquireResource",
                "releaseResource",
                "waitForResource",
                "areResourcesFree",
                "checkResourceFree",
                "createResource",
                "deleteResource",
                "acquireResourcesTree",
                "waitForOptionalResourcesTree",
            ),
            {},
        ),
        ("ALDiagnosis", "Faults: none.", (), {"ActiveDiagnosis": None, "EnableNotification": True}),
        ("ALLogger", "Messages of the log.", ("debug", "error", "fatal", "info", "warn", "logInFile"), {}),
        ("ALNotificationManager", "Notifications: none.", ("remove", "add"), {}),
        ("ALChestButton", "The button on the chest, which nobody presses.", SUBSCRIBE, {}),
        ("ALVisualCompass", "The visual compass.", SUBSCRIBE, {}),
        (
            "ALWorldRepresentation",
            "Objects in the world.",
            ("addAttributeToCategory", "clearObject", "removeObject"),
            {},
        ),
    )
)

NOT_SIMULATED = {
    "ALDialog": "the twin understands no speech",
    "ALSpeechRecognition": "the twin understands no speech",
    "ALVoiceEmotionAnalysis": "the twin hears nothing",
    "ALMood": "the twin sees no people",
    "ALUserSession": "the twin sees no people",
    "ALVisionRecognition": "the twin recognizes no pictures",
    "ALPhotoCapture": "pictures come from ALVideoDevice",
    "ALVideoRecorder": "pictures come from ALVideoDevice",
    "ALCloseObjectDetection": "obstacles come from the scene",
    "ALDarknessDetection": "the twin has no lamps",
    "ALBacklightingDetection": "the twin has no lamps",
    "ALSegmentation3D": "depth pictures come from ALVideoDevice",
    "ALLocalizationMap": "the twin keeps no map",
    "ALRecharge": "the twin has no charging station",
    "ALStore": "nothing can be installed",
    "PackageManager": "nothing can be installed",
}
"""Module -> why all of its methods are refused by name."""


OFTEN_CALLED = {
    "ALDialog": (
        "loadTopic",
        "loadTopicContent",
        "unloadTopic",
        "activateTopic",
        "deactivateTopic",
        "subscribe",
        "unsubscribe",
        "setLanguage",
        "getLanguage",
        "runDialog",
        "stopDialog",
        "gotoTopic",
        "gotoTag",
        "setConcept",
        "addToConcept",
        "setFocus",
        "getAllLoadedTopics",
        "getLoadedTopics",
        "getActivatedTopics",
        "setAnimatedSpeechConfiguration",
        "compileAll",
        "forceInput",
        "forceOutput",
        "say",
        "clearConcepts",
        "setDelay",
        "addBlockingEvent",
        "deactivateTag",
        "activateTag",
        "openSession",
        "closeSession",
        "resetAll",
    ),
    "ALSpeechRecognition": (
        "setVocabulary",
        "setLanguage",
        "getLanguage",
        "setAudioExpression",
        "setVisualExpression",
        "subscribe",
        "unsubscribe",
        "pause",
        "setParameter",
        "getParameter",
        "addContext",
        "removeAllContext",
        "compile",
        "getAvailableLanguages",
        "setWordListAsVocabulary",
        "setSensitivity",
    ),
    "ALPhotoCapture": (
        "takePicture",
        "takePictures",
        "setResolution",
        "setPictureFormat",
        "setCameraID",
        "setColorSpace",
        "setCaptureInterval",
        "setHalfPressEnabled",
    ),
    "ALVideoRecorder": (
        "startRecording",
        "stopRecording",
        "setResolution",
        "setFrameRate",
        "setVideoFormat",
        "setCameraID",
        "setColorSpace",
        "isRecording",
    ),
    "ALMood": (
        "subscribe",
        "unsubscribe",
        "currentPersonState",
        "ambianceState",
        "getEmotionalReaction",
        "persons",
    ),
    "ALUserSession": ("getOpenUserSessions", "getFocusedUser", "doUsersExist", "getUserList"),
    "ALVisionRecognition": ("subscribe", "unsubscribe", "load", "detectFromFile", "getSize"),
    "ALRecharge": ("goToStation", "leaveStation", "lookForStation", "dockOnStation", "moveInFrontOfStation"),
}
"""Module -> methods that clients of libqi find, which cannot ask for others."""


class RefusedModule(Module):
    """A module that the robot has and the twin does not simulate: its methods answer so."""

    def getMethodList(self) -> list[str]:
        """Return the names of the methods that clients find."""
        return sorted({*super().getMethodList(), *OFTEN_CALLED.get(self.name, ())})

    def __getattr__(self, name: str) -> Callable[..., Any]:
        """Return a function that says that a method is not simulated."""
        if name.startswith("_"):
            raise AttributeError(name)

        def refuse(*_: object) -> None:
            raise NotSimulatedError(self.name, name, NOT_SIMULATED[self.name])

        return refuse


def _refused(name: str) -> type[RefusedModule]:
    return type(name, (RefusedModule,), {"name": name, "__doc__": f"Not simulated: {NOT_SIMULATED[name]}."})


MODULES: tuple[type[Module], ...] = (ALTabletService, *STATES, *(_refused(name) for name in NOT_SIMULATED))
