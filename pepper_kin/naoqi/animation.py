"""ALAnimationPlayer, ALBehaviorManager: animations by name and by tag."""

from __future__ import annotations

from typing import Any

from pepper_kin.motion import gesture, gesture_names
from pepper_kin.naoqi.effectors import standing_pepper
from pepper_kin.naoqi.errors import quoted
from pepper_kin.naoqi.joint_tasks import TrajectoryTask
from pepper_kin.naoqi.module import Module
from pepper_kin.naoqi.tables import table

PREFIX = "animations/Stand/Gestures/"


class ALAnimationPlayer(Module):
    """Animations: gestures of this library under the names that scripts use."""

    name = "ALAnimationPlayer"

    def run(self, path: str) -> None:
        """Play the gesture that stands for an animation; return when it has ended."""
        if not isinstance(path, str) or not path:
            raise self.fail("run", f"path: got {quoted(path)}, expected the name of an animation")
        self.play(gesture_for(path))

    def runTag(self, tag: str, *_: Any) -> None:
        """Play the animation of a tag; return when it has ended."""
        known = self._tags()
        if str(tag).lower() not in known:
            raise self.fail("runTag", f"tag: got {quoted(tag)}, expected one of {', '.join(known)}")
        self.play(known[str(tag).lower()])

    def stop(self, id: int = 0) -> None:
        """End the animation that plays."""
        with self.body.time.lock:
            self.body.tasks.kill([t for t in self.body.tasks if t.name == "animation"], self.body)

    def reset(self) -> None:
        """Remove the declared tags."""
        self.__dict__.pop("_own_tags", None)

    def declareTagForAnimations(self, tags: Any) -> None:
        """Declare further tags, {tag: [animation, ...]}; the first animation of each tag is used."""
        own = self.__dict__.setdefault("_own_tags", {})
        for tag, animations in dict(tags).items():
            own[str(tag).lower()] = gesture_for(str(animations[0]))

    addTagForAnimations = declareTagForAnimations

    def getTagList(self) -> list[str]:
        """Return all tags."""
        return sorted(self._tags())

    def getAnimationsByTag(self, tag: str) -> list[str]:
        """Return the animations with a tag."""
        found = self._tags().get(str(tag).lower())
        return [] if found is None else [f"{PREFIX}{found}_1"]

    def play(self, name: str) -> None:
        """Play a gesture; return when it has ended."""
        self.body.wait(self.body.do(animation(name)))

    def _tags(self) -> dict[str, str]:
        return {
            **{tag.rstrip("_"): name for tag, name in table("gestures").items()},
            **self.__dict__.get("_own_tags", {}),
        }


def gesture_for(name: str) -> str:
    """Return the gesture that stands for an animation ("animations/Stand/Gestures/Hey_1").

    "explain" for a name that no gesture matches.
    """
    last = name.rstrip("/").split("/")[-1].lower() + "_"
    for part, meant in table("gestures").items():
        if last.startswith(part):
            return meant
    for part, meant in table("gestures").items():
        if len(part) > 3 and part in last:
            return meant
    return "explain"


def animation(name: str) -> TrajectoryTask:
    """Return the task that plays a gesture."""
    return TrajectoryTask("animation", gesture(standing_pepper(), name))


class ALBehaviorManager(Module):
    """Behaviors: the library's animations under their names; no other behavior is installed."""

    name = "ALBehaviorManager"

    def getInstalledBehaviors(self) -> list[str]:
        """Return the behaviors that `runBehavior` takes."""
        return [f"{PREFIX}{name}_1" for name in gesture_names()]

    getBehaviorNames = getInstalledBehaviors

    getSystemBehaviorNames = getInstalledBehaviors

    def isBehaviorInstalled(self, name: str) -> bool:
        """Return whether a behavior can be run."""
        return "animations/" in str(name)

    isBehaviorPresent = isBehaviorInstalled

    def _resolved(self, _method: str, name: str) -> str:
        return name if self.isBehaviorInstalled(name) else ""

    def runBehavior(self, name: str) -> None:
        """Play an animation; return when it has ended."""
        if not self.isBehaviorInstalled(name):
            raise self.fail("runBehavior", f"{quoted(name)} is not installed; the twin has animations only")
        self.broker.module("ALAnimationPlayer").run(name)

    def startBehavior(self, name: str) -> None:
        """Start an animation; return at once."""
        if not self.isBehaviorInstalled(name):
            raise self.fail("startBehavior", f"{quoted(name)} is not installed; the twin has animations only")
        self.body.do(animation(gesture_for(name)))

    def stopBehavior(self, name: str) -> None:
        """End the animation that plays."""
        self.broker.module("ALAnimationPlayer").stop()

    def stopAllBehaviors(self) -> None:
        """End the animation that plays."""
        self.broker.module("ALAnimationPlayer").stop()

    def isBehaviorRunning(self, name: str) -> bool:
        """Return whether an animation plays."""
        return bool(self.getRunningBehaviors())

    def getRunningBehaviors(self) -> list[str]:
        """Return the animations that play."""
        with self.body.time.lock:
            return [task.name for task in self.body.tasks if task.name == "animation"]


MODULES = (ALAnimationPlayer, ALBehaviorManager)
