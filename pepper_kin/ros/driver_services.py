"""Topics and services of naoqi_driver2 and ros2_control about the robot itself."""

from __future__ import annotations

import logging
from collections import deque
from typing import TYPE_CHECKING, Any

from pepper_kin.naoqi.device_keys import TOP, DeviceKeys
from pepper_kin.naoqi.joint_names import ACTUATED
from pepper_kin.naoqi.tables import table
from pepper_kin.ros.message_parts import header
from pepper_kin.ros.qos import LATCHED
from pepper_kin.ros_messages import message_type

if TYPE_CHECKING:
    from pepper_kin.ros.node import RobotNode

logger = logging.getLogger(__name__)

DRIVER = "/naoqi_driver"
LANGUAGES = ("Chinese", "English", "French", "German", "Italian", "Japanese", "Spanish")
"""Languages that `set_language` accepts, without effect on speech."""

WARM, HOT = 68.0, 74.0
"""Motor temperatures from which the driver warns and reports an error [degrees C]."""

CONTROLLER = "joint_trajectory_controller/JointTrajectoryController"
STATE_RATE = 50  # [Hz]; listed rate of the controllers


class DriverServices:
    """Topics and services about the robot itself.

    Args:
        node: The node.

    Attributes:
        said: The last texts of `/speech`.
        language: Language that was set by `set_language`.
    """

    def __init__(self, node: RobotNode) -> None:
        self.node, self.language = node, "English"
        self.said: deque[str] = deque(maxlen=100)
        self._keys = DeviceKeys(node.body)
        info = message_type("naoqi_bridge_msgs/msg/StringStamped")(header=header(node.now), data=self._info())
        node.advertise("/info", info.type_name, LATCHED).publish(info)
        self._diagnostics = node.advertise("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
        node.listen("/speech", "std_msgs/msg/String", self.on_speech)
        services = "naoqi_bridge_msgs/srv/"
        node.offer_service(f"{DRIVER}/get_robot_config", f"{services}GetRobotInfo", self.robot_config)
        node.offer_service(f"{DRIVER}/get_language", f"{services}GetString", self.get_language)
        node.offer_service(f"{DRIVER}/set_language", f"{services}SetString", self.set_language)
        listing = "controller_manager_msgs/srv/ListControllers"
        node.offer_service("/controller_manager/list_controllers", listing, self.list_controllers)

    def publish(self) -> None:
        """Publish the diagnostics if there is a subscription; called with the body's lock held."""
        if self._diagnostics.subscription_count:
            self._diagnostics.publish(self.diagnostics())

    def on_speech(self, message: Any) -> None:
        """Store and log the text to be spoken; the twin has no voice."""
        self.said.append(str(message.data))
        logger.info("says: %s", message.data)

    def robot_config(self, _: Any) -> Any:
        """Return naoqi_bridge_msgs/srv/GetRobotInfo_Response: values of `ALMotion.getRobotConfig`."""
        known = dict(zip(*table("motion")["robot_config"], strict=True))
        kind: Any = message_type("naoqi_bridge_msgs/msg/RobotInfo")
        info = kind(
            type=kind.PEPPER,
            model=known["Model Type"],
            head_version=known["Head Version"],
            body_version=known["Body Version"],
            has_laser=known["Laser"],
            has_extended_arms=known["Extended Arms"],
            number_of_legs=known["Number of Legs"],
            number_of_arms=known["Number of Arms"],
            number_of_hands=known["Number of Hands"],
        )
        return message_type("naoqi_bridge_msgs/srv/GetRobotInfo_Response")(info=info)

    def get_language(self, _: Any) -> Any:
        """Return naoqi_bridge_msgs/srv/GetString_Response."""
        return message_type("naoqi_bridge_msgs/srv/GetString_Response")(data=self.language)

    def set_language(self, request: Any) -> Any:
        """Set a known language; return naoqi_bridge_msgs/srv/SetString_Response."""
        success = str(request.data) in LANGUAGES
        if success:
            self.language = str(request.data)
        return message_type("naoqi_bridge_msgs/srv/SetString_Response")(success=success)

    def list_controllers(self, _: Any) -> Any:
        """Return controller_manager_msgs/srv/ListControllers_Response: all are active.

        Each controller claims its joints while it moves them.
        """
        kind = message_type("controller_manager_msgs/msg/ControllerState")
        listed = []
        for name, controller in self.node.controllers.items():
            command = [f"{joint}/position" for joint in controller.joints]
            moves = controller.task is not None and not controller.task.ended
            listed.append(
                kind(
                    name=name,
                    state="active",
                    type=CONTROLLER,
                    update_rate=STATE_RATE,
                    claimed_interfaces=command if moves else [],
                    required_command_interfaces=command,
                    required_state_interfaces=[
                        f"{joint}/{what}" for joint in controller.joints for what in ("position", "velocity")
                    ],
                )
            )
        return message_type("controller_manager_msgs/srv/ListControllers_Response")(controller=listed)

    def diagnostics(self) -> Any:
        """Return diagnostic_msgs/msg/DiagnosticArray with the driver's contents: joints and battery."""
        pepper, body = self.node.body.pepper, self.node.body
        made, heat, stiffness = [], [], []
        for name in ACTUATED:
            k = body.index[name]
            heat.append(float(self._value(f"{TOP}{name}/Temperature/Sensor/Value")))
            stiffness.append(float(body.stiffness[name]))
            values = {
                "Temperature": heat[-1],
                "Stiffness": stiffness[-1],
                "minAngle": float(pepper.lower_limits[k]),
                "maxAngle": float(pepper.upper_limits[k]),
                "maxVelocity": float(pepper.velocity_limits[k]),
                "maxTorque": float(pepper.effort_limits[k]),
            }
            made.append(_status(f"naoqi_driver_joints:{name}", name, _level(heat[-1]), values))
        hot = [f"{name}: {t:g} C" for name, t in zip(ACTUATED, heat, strict=True) if t >= WARM]
        fingers = [s for name, s in zip(ACTUATED, stiffness, strict=True) if "Hand" not in name]
        joints = {
            "Highest Temperature": max(heat),
            "Highest Stiffness": max(stiffness),
            "Lowest Stiffness": min(stiffness),
            "Lowest Stiffness without Hands": min(fingers),
            "Hot Joints": "; ".join(hot),
        }
        made.append(_status("naoqi_driver_joints:Status", "joints", _level(max(heat)), joints))
        charge = int(self._value("BatteryChargeChanged"))
        level = (
            (0, "OK")
            if charge > 60
            else (1, "Battery discharging")
            if charge > 30
            else (2, "Battery almost empty")
        )
        made.append(_status("naoqi_driver_battery:Status", "battery", level, {"Percentage": charge}))
        return message_type("diagnostic_msgs/msg/DiagnosticArray")(header=header(self.node.now), status=made)

    def _value(self, key: str) -> Any:
        return self._keys[key]

    def _info(self) -> str:
        """Return the twin's configuration keys and values, in the driver's format."""
        return " ; ".join(
            f"{key}: {self._value(key)}" for key in self._keys.names if key.startswith("RobotConfig/")
        )


def _level(heat: float) -> tuple[int, str]:
    if heat < WARM:
        return 0, "OK"
    return (1, "Hot") if heat < HOT else (2, "Too hot")


def _status(name: str, hardware: str, level: tuple[int, str], values: dict[str, Any]) -> Any:
    pair = message_type("diagnostic_msgs/msg/KeyValue")
    listed = [pair(key=key, value=str(value)) for key, value in values.items()]
    kind = message_type("diagnostic_msgs/msg/DiagnosticStatus")
    return kind(name=name, hardware_id=hardware, level=level[0], message=level[1], values=listed)
