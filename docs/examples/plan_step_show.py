"""Plan, step and show: python plan_step_show.py [SECONDS] [VIEWER]."""

import sys

import sumo_dist as sd

seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 30.0
viewer = sys.argv[2] if len(sys.argv) > 2 else "web"

with sd.MPC("spot/move_box", seed=1) as mpc, sd.show(mpc, viewer=viewer) as view:
    robot = sd.Plant(mpc.task.scene, mpc.start(seed=1))
    while not (ending := mpc.ending(robot.truth)) and mpc.tick * 0.02 < seconds:
        view.state(robot.truth)
        robot.send(mpc.step(robot.truth))
        robot.advance()
    view.save("plan_step_show.rrd")
    print(ending or "out of time", "after", mpc.tick, "ticks")
    view.wait()
