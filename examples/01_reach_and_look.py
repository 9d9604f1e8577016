"""Reach over a table with the left hand while looking at the target: the main job in fifteen lines."""

import pepper_kin as pk

pepper = pk.load_pepper()
scene = pk.Scene().add_box("table", size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.715))
point = (0.38, 0.22, 0.82)
tasks = [pk.ik.HandPosition("left", point), pk.ik.LookAt(point)]

plan = pk.plan(pepper, pepper.posture("Ready"), tasks, scene, seed=0)
print(plan.report())
trajectory = pk.retime(pepper, plan)
certificate = trajectory.check(pepper, scene=scene)
print(certificate.report())
run = pk.Twin(pepper, scene=scene).execute(trajectory)
print(run.report())
pk.Viewer(pepper).add_scene(scene).save_html("reach_and_look.html", run)

assert plan.success
assert certificate.success
