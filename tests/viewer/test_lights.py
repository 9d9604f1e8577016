"""Lights of Pepper on the page: where they are, and the commands that paint them."""

import numpy as np
import pytest
import umsgpack

import pepper_kin as pk
from pepper_kin.naoqi import Broker
from pepper_kin.naoqi.body_page import BodyPage, shade
from pepper_kin.naoqi.leds import GROUPS
from pepper_kin.viewer.lights import pepper_lights
from pepper_kin.viewer.surface import read_surface


def test_every_light_is_drawn_on_its_side_and_all_of_a_ring_is_some_light():
    pepper = pk.load_pepper()
    lights = pepper_lights(pepper)
    assert set(lights) == set(GROUPS["AllLeds"])
    for name, light in lights.items():
        if name != "ChestLeds":
            assert (light.geometry.vertices[:, 1].mean() > 0) == name.startswith("Left"), name
    for shape, part in (("head_eye_rings", "FaceLed"), ("head_ear_rings", "EarLed")):
        (mesh,) = (s.geometry for s in pepper.visual_shapes if s.name == shape)
        faces = sum(len(light.geometry.faces) for name, light in lights.items() if part in name)
        assert faces == len(read_surface(mesh.path).faces)


def test_lights_of_the_top_are_above_those_of_the_bottom():
    lights = pepper_lights(pk.load_pepper())
    height = {name: light.geometry.vertices[:, 2].mean() for name, light in lights.items() if "Face" in name}
    top, bottom = (GROUPS[f"FaceLeds{part}"] for part in ("Top", "Bottom"))
    assert (
        min(height[name] for name in top)
        > np.mean(list(height.values()))
        > max(height[name] for name in bottom)
    )


def test_a_page_that_opens_later_has_the_colors_of_now():
    with Broker(real_time=False) as broker:
        leds = broker.module("ALLeds")
        page = BodyPage(broker.body, lights=leds.colors)
        try:
            leds.fadeRGB("LeftFaceLeds", "red", 0.1)
            leds.off("RightFaceLed3")
            broker.body.time.sleep(0.1)
            commands = page.viewer._live().call(lambda s: list(map(umsgpack.unpackb, s.board.snapshot())))
            painted = {c["path"]: c["value"] for c in commands if c.get("property") == "color"}
            assert painted["/robot/lights/LeftFaceLed2"] == pytest.approx([1.0, 0.12, 0.13, 1.0])
            assert painted["/robot/lights/RightFaceLed3"] == pytest.approx(shade((0.0, 0.0, 0.0)))
            assert painted["/robot/lights/RightFaceLed4"] == pytest.approx([1.0, 1.0, 1.0, 1.0])
        finally:
            page.close()
