"""ALTextToSpeech and ALAnimatedSpeech: silent speech, which takes time and is logged."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from pepper_kin.naoqi.animation import animation, gesture_for
from pepper_kin.naoqi.errors import quoted
from pepper_kin.naoqi.module import Module

LETTER_TIME = 0.06
"""Time for a letter at speed 100 [s] (assumed: some 160 words a minute)."""

LONGEST = 60.0
"""Maximum time for one call [s]."""

_CONTEXT = re.compile(r"\^(\w+)\(([^)]*)\)")

MODES = {"disabled": 0, "random": 1, "contextual": 2}


@dataclass(frozen=True)
class Spoken:
    """A spoken text.

    Attributes:
        time: Start time [s].
        text: Text without tags.
        language: Language of the text.
    """

    time: float
    text: str
    language: str


def plain(text: str) -> str:
    """Return a text without tags of speech and animations."""
    return " ".join(re.sub(r"\\[^\\]*\\", " ", _CONTEXT.sub(" ", text)).split())


def pause_in(text: str) -> float:
    r"""Return the pauses (\pau=500\) in a text [s]."""
    return sum(float(ms) for ms in re.findall(r"\\pau=(\d+)\\", text)) / 1000.0


class ALTextToSpeech(Module):
    """Speech, whose time depends on the number of letters; `spoken` lists it."""

    name = "ALTextToSpeech"

    def __init__(self, broker: Any) -> None:
        super().__init__(broker)
        self.spoken: list[Spoken] = []
        self._parameters: dict[str, float] = {"speed": 100.0, "pitchShift": 1.0, "defaultVoiceSpeed": 100.0}
        self._stopped = False

    def say(self, text: str, language: Any = None) -> None:
        """Say a text; return when it is spoken."""
        if not isinstance(text, str):
            raise self.fail("say", f"text: got {quoted(text)}, expected a string")
        words = plain(text)
        chosen = language if isinstance(language, str) else self.getLanguage()
        memory = self.broker.memory
        self._stopped = False
        self.spoken.append(Spoken(self.body.time.now, words, chosen))
        self.broker.log(f"says: {words}")
        memory.raiseEvent("ALTextToSpeech/CurrentSentence", words)
        memory.raiseEvent("ALTextToSpeech/TextStarted", 1)
        speed = max(self._parameters["speed"], 50.0) / 100.0
        end = self.body.time.now + min(LETTER_TIME * len(words) / speed + pause_in(text), LONGEST)
        self.body.time.wait_until(lambda: self._stopped or self.body.time.now >= end)
        memory.raiseEvent("ALTextToSpeech/CurrentSentence", "")
        memory.raiseEvent("ALTextToSpeech/TextDone", 1)

    def sayToFile(self, text: str, fileName: str) -> None:
        """Raise NaoqiError: the twin makes no sound."""
        raise self.fail("sayToFile", "is not simulated: the twin makes no sound")

    def stopAll(self) -> None:
        """Stop speaking."""
        self._stopped = True

    def setVolume(self, volume: float) -> None:
        """Set the volume, 0 to 1."""
        value = self.number("setVolume", "volume", volume)
        if not 0.0 <= value <= 1.0:
            raise self.fail("setVolume", f"volume: got {value:g}, expected a number from 0 to 1")
        self.kept["volume",] = value

    def setParameter(self, pEffectName: str, pEffectValue: float) -> None:
        """Set "speed" (50 to 400), "pitchShift", ..."""
        self._parameters[str(pEffectName)] = self.number("setParameter", "pEffectValue", pEffectValue)

    def getParameter(self, pParameterName: str) -> float:
        """Return the value of a parameter."""
        if pParameterName not in self._parameters:
            raise self.fail("getParameter", f"unknown parameter {quoted(pParameterName)}")
        return self._parameters[pParameterName]

    def resetSpeed(self) -> None:
        """Set the speed to 100."""
        self._parameters["speed"] = 100.0

    def locale(self) -> str:
        """Return the locale of the language."""
        return {"English": "en_US", "French": "fr_FR", "German": "de_DE"}.get(self.getLanguage(), "en_US")


class ALAnimatedSpeech(Module):
    """Speech with gestures of the text; unless "disabled", long texts without gestures get one."""

    name = "ALAnimatedSpeech"

    def __init__(self, broker: Any) -> None:
        super().__init__(broker)
        self._words: dict[str, list[str]] = {}

    def say(self, text: str, configuration: Any = None) -> None:
        """Say a text with gestures ("^start(animations/Stand/Gestures/Hey_1) Hello"); return when spoken."""
        if not isinstance(text, str):
            raise self.fail("say", f"text: got {quoted(text)}, expected a string")
        begun = ("start", "run", "startTag", "runTag")
        gestures = [gesture_for(what) for do, what in _CONTEXT.findall(text) if do in begun]
        if not gestures and self._mode_of(configuration) > 0 and len(plain(text)) > 20:
            gestures = ["explain"]
        tasks = [self.body.do(animation(name)) for name in gestures]
        self.broker.module("ALTextToSpeech").say(text)
        if "^wait(" in text:
            for task in tasks:
                self.body.wait(task)
        elif tasks:
            with self.body.time.lock:
                self.body.tasks.kill([t for t in tasks if not t.started], self.body)

    def _mode_of(self, configuration: Any) -> int:
        if isinstance(configuration, dict):
            return MODES.get(str(configuration.get("bodyLanguageMode", "")), self.getBodyLanguageMode())
        return int(self.getBodyLanguageMode())

    def setBodyTalkEnabled(self, enable: bool) -> None:
        """Set whether speech comes with gestures."""
        self.kept["mode",] = 2 if enable else 0

    setBodyLanguageEnabled = setBodyTalkEnabled

    def isBodyTalkEnabled(self) -> bool:
        """Return whether speech comes with gestures."""
        return bool(self.getBodyLanguageMode() > 0)

    isBodyLanguageEnabled = isBodyTalkEnabled

    def setBodyLanguageModeFromStr(self, stringBodyLanguageMode: str) -> None:
        """Set the mode: "disabled", "random" or "contextual"."""
        if stringBodyLanguageMode not in MODES:
            known = ", ".join(MODES)
            raise self.fail(
                "setBodyLanguageModeFromStr", f"got {quoted(stringBodyLanguageMode)}, expected one of {known}"
            )
        self.kept["mode",] = MODES[stringBodyLanguageMode]

    def setBodyLanguageMode(self, bodyLanguageMode: int) -> None:
        """Set the mode: 0 (disabled), 1 (random) or 2 (contextual)."""
        if bodyLanguageMode not in MODES.values():
            raise self.fail("setBodyLanguageMode", f"got {quoted(bodyLanguageMode)}, expected 0, 1 or 2")
        self.kept["mode",] = int(bodyLanguageMode)

    def getBodyLanguageModeToStr(self) -> str:
        """Return "disabled", "random" or "contextual"."""
        return next(name for name, value in MODES.items() if value == self.getBodyLanguageMode())

    def addTagsToWords(self, tagsToWords: Any) -> None:
        """Store the words of tags, {tag: [word, ...]}."""
        self._words.update({str(tag): list(words) for tag, words in dict(tagsToWords).items()})

    def declareTagForAnimations(self, tagsToAnimations: Any) -> None:
        """Declare further tags of animations, {tag: [animation, ...]}."""
        self.broker.module("ALAnimationPlayer").declareTagForAnimations(tagsToAnimations)


MODULES = (ALTextToSpeech, ALAnimatedSpeech)
