// A client of roslib (npm): PORT JOB [POSITION] -> what it found, as JSON.
import { Action, Ros, Service, Topic } from "roslib";

const [port, job, position] = process.argv.slice(2);
const ros = new Ros({ url: `ws://127.0.0.1:${port}` });
const sleep = (seconds) => new Promise((resolve) => setTimeout(resolve, 1000 * seconds));
await new Promise((resolve, reject) => {
  ros.on("connection", resolve);
  ros.on("error", reject);
});

// Wait for a condition, or for the time; the assertion of the test says what is missing.
async function until(condition, seconds = 30) {
  const end = Date.now() + 1000 * seconds;
  while (!condition() && Date.now() < end) await sleep(0.05);
}

const publisher = (name, messageType) => new Topic({ ros, name, messageType });

const points = (pairs) =>
  pairs.map(([time, positions]) => ({
    positions,
    time_from_start: { sec: Math.floor(time), nanosec: Math.round((time % 1) * 1e9) },
  }));
const tolerances = (values) => values.map(([name, position]) => ({ name, position }));
const goal = (joints, pairs, { path = [], end = [], time = 0 } = {}) => ({
  trajectory: { joint_names: joints, points: points(pairs) },
  path_tolerance: tolerances(path),
  goal_tolerance: tolerances(end),
  goal_time_tolerance: { sec: 0, nanosec: Math.round(time * 1e9) },
});

// roslib hands on `values` of reached goals alone: status and text of the others are read from the socket's messages.
const results = new Map();
const emit = ros.emit.bind(ros);
ros.emit = (name, message, ...rest) => {
  if (message?.op === "action_result") results.set(message.id, message);
  return emit(name, message, ...rest);
};

async function act(controller, values, cancelAfter = null) {
  const action = new Action({
    ros,
    name: `/${controller}/follow_joint_trajectory`,
    actionType: "control_msgs/action/FollowJointTrajectory",
  });
  let feedback = 0;
  let id;
  const ended = new Promise((resolve) => {
    id = action.sendGoal(values, resolve, () => feedback++, resolve);
  });
  if (cancelAfter !== null) {
    await sleep(cancelAfter);
    action.cancelGoal(id);
  }
  await ended;
  const { status, values: found } = results.get(id);
  return { status, code: found.error_code, text: found.error_string, feedback };
}

function call(name, type, request) {
  return new Promise((resolve, reject) => new Service({ ros, name, serviceType: type }).callService(request, resolve, reject));
}

async function topics() {
  const known = await call("/rosapi/topics", "rosapi_msgs/srv/Topics", {});
  const received = {};
  known.topics.forEach((name, k) =>
    new Topic({ ros, name, messageType: known.types[k] }).subscribe((message) => (received[name] = message)),
  );
  await sleep(2.5);
  const place = () => received["/odom"].pose.pose.position.x;
  const joint = (name) => {
    const state = received["/joint_states"];
    return state.position[state.name.indexOf(name)];
  };
  publisher("/joint_angles", "naoqi_bridge_msgs/msg/JointAnglesWithSpeed").publish({
    joint_names: ["HeadYaw"],
    joint_angles: [0.25],
    speed: 0.5,
  });
  for (const [topic, name, angle] of [
    ["/LeftArm_controller/joint_trajectory", "LElbowYaw", -1.0],
    ["/pepper_robot/joint_trajectory", "RElbowYaw", 1.0],
  ]) {
    const arm = publisher(topic, "trajectory_msgs/msg/JointTrajectory");
    arm.publish({ joint_names: [name], points: points([[0.5, [angle]]]) });
  }
  await until(() => Math.abs(joint("LElbowYaw") + 1.0) + Math.abs(joint("RElbowYaw") - 1.0) < 0.01);
  await until(() => Math.abs(joint("HeadYaw") - 0.25) < 0.005);
  const drove = [];
  for (const topic of ["/cmd_vel", "/model/pepper_robot/cmd_vel"]) {
    const x = place();
    const drive = publisher(topic, "geometry_msgs/msg/Twist");
    await until(() => {
      drive.publish({ linear: { x: 0.1 } });
      return place() - x > 0.03;
    });
    await sleep(1.0);
    drove.push(place() - x);
  }
  const x = place();
  publisher("/move_base_simple/goal", "geometry_msgs/msg/PoseStamped").publish({
    header: { frame_id: "base_footprint" },
    pose: { position: { x: -0.1 }, orientation: { w: 1.0 } },
  });
  await until(() => place() - x < -0.05);
  await sleep(1.5);
  return {
    received: Object.keys(received),
    names: received["/joint_states"].name,
    joints: ["HeadYaw", "LElbowYaw", "RElbowYaw"].map(joint),
    picture: Buffer.from(received["/camera/front/image_raw"].data, "base64").length,
    drove,
    base: place() - x,
  };
}

// Let the left palm follow a position in base_footprint.
async function follow() {
  const [x, y, z] = JSON.parse(position);
  const topic = publisher("/pepper_robot/follow_target/left", "geometry_msgs/msg/PoseStamped");
  for (let k = 0; k < 40; k++) {
    topic.publish({ header: { frame_id: "base_footprint" }, pose: { position: { x, y, z }, orientation: { w: 1.0 } } });
    await sleep(0.1);
  }
  return {};
}

// Hear every sensor of touch pressed and released.
async function touched() {
  const found = { bumper: [], head_touch: [], hand_touch: [] };
  const kinds = { bumper: "Bumper", head_touch: "HeadTouch", hand_touch: "HandTouch" };
  const touched = { bumper: ["bumper", 2], head_touch: ["button", 2], hand_touch: ["hand", 3] };
  const both = ([name, [key, id]]) =>
    [0, 1].every((state) => found[name].map((text) => JSON.parse(text)).some((m) => m[key] === id && m.state === state));
  for (const [name, kind] of Object.entries(kinds)) {
    publisher(`/${name}`, `naoqi_bridge_msgs/msg/${kind}`).subscribe((message) => {
      const text = JSON.stringify(message);
      if (!found[name].includes(text)) found[name].push(text);
    });
  }
  await sleep(0.5);
  console.log("listening");
  await until(() => Object.entries(touched).every(both), 120);
  return Object.fromEntries(Object.entries(found).map(([name, states]) => [name, states.sort().map((s) => JSON.parse(s))]));
}

async function actions() {
  const head = "Head_controller";
  const reached = await act(head, goal(["HeadYaw"], [[1.0, [0.3]]]));
  const canceled = await act(head, goal(["HeadYaw"], [[5.0, [0.0]]]), 0.7);
  const first = act(head, goal(["HeadYaw"], [[6.0, [-0.5]]]));
  await sleep(0.7);
  const second = await act(head, goal(["HeadYaw"], [[1.0, [0.1]]]));
  return {
    reached,
    feedback: reached.feedback,
    replaced: await first,
    second,
    canceled: { status: canceled.status, text: canceled.text },
    "wrong joints": await act(head, goal(["Tail"], [[1.0, [0.3]]])),
    "path tolerance": await act(head, goal(["HeadYaw"], [[0.05, [1.8]]], { path: [["HeadYaw", 0.05]] })),
    "goal tolerance": await act(head, goal(["HeadYaw"], [[0.02, [-1.8]]], { end: [["HeadYaw", 1e-6]], time: 0.1 })),
  };
}

const jobs = {
  topics,
  follow,
  touched,
  actions,
  left: () => act("LeftArm_controller", goal(["LElbowYaw"], [[1.5, [-0.8]]])),
  right: () => act("RightArm_controller", goal(["RElbowYaw"], [[1.5, [0.8]]])),
  die: () => act("Head_controller", goal(["HeadYaw"], [[0.1, [0.0]], [60.0, [1.9]]])),
};
console.log(JSON.stringify(await jobs[job]()));
process.exit(0);
