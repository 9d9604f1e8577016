// A client of roslib (npm): PORT JOB -> what it found, as JSON.
import { Action, Ros, Service, Topic } from "roslib";

const [port, job] = process.argv.slice(2);
const ros = new Ros({ url: `ws://127.0.0.1:${port}` });
const sleep = (seconds) => new Promise((resolve) => setTimeout(resolve, 1000 * seconds));
await new Promise((resolve, reject) => {
  ros.on("connection", resolve);
  ros.on("error", reject);
});

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
  const x = received["/odom"].pose.pose.position.x;
  const publisher = (name, messageType) => new Topic({ ros, name, messageType });
  const drive = publisher("/cmd_vel", "geometry_msgs/msg/Twist");
  publisher("/joint_angles", "naoqi_bridge_msgs/msg/JointAnglesWithSpeed").publish({
    joint_names: ["HeadYaw"],
    joint_angles: [0.25],
    speed: 0.5,
  });
  publisher("/LeftArm_controller/joint_trajectory", "trajectory_msgs/msg/JointTrajectory").publish({
    joint_names: ["LElbowYaw"],
    points: points([[0.5, [-1.0]]]),
  });
  for (let k = 0; k < 10; k++) {
    drive.publish({ linear: { x: 0.1 } });
    await sleep(0.1);
  }
  await sleep(1.0);
  const state = received["/joint_states"];
  return {
    received: Object.keys(received),
    names: state.name,
    joint: state.position[state.name.indexOf("HeadYaw")],
    picture: Buffer.from(received["/camera/front/image_raw"].data, "base64").length,
    drove: received["/odom"].pose.pose.position.x - x,
  };
}

async function actions() {
  const head = "Head_controller";
  const reached = await act(head, goal(["HeadYaw"], [[1.0, [0.3]]]));
  const canceled = await act(head, goal(["HeadYaw"], [[5.0, [0.0]]]), 0.7);
  return {
    reached,
    feedback: reached.feedback,
    canceled: { status: canceled.status, text: canceled.text },
    "wrong joints": await act(head, goal(["Tail"], [[1.0, [0.3]]])),
    "path tolerance": await act(head, goal(["HeadYaw"], [[0.05, [1.8]]], { path: [["HeadYaw", 0.05]] })),
    "goal tolerance": await act(head, goal(["HeadYaw"], [[0.02, [-1.8]]], { end: [["HeadYaw", 1e-6]], time: 0.1 })),
  };
}

const jobs = {
  topics,
  actions,
  left: () => act("LeftArm_controller", goal(["LElbowYaw"], [[1.5, [-0.8]]])),
  right: () => act("RightArm_controller", goal(["RElbowYaw"], [[1.5, [0.8]]])),
  die: () => act("Head_controller", goal(["HeadYaw"], [[0.1, [0.0]], [30.0, [1.9]]])),
};
console.log(JSON.stringify(await jobs[job]()));
process.exit(0);
