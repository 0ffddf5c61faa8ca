"""Publishes the u16 counts that come on standard input: driver.py SENSOR ROWS COLUMNS METRES_PER_COUNT"""

import sys

import natural_kinds

sensor, rows, columns, metres_per_count = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4])
forward = natural_kinds.Command(forward_m_s=0.2, turn_rad_s=0.0)
device = open(0, "rb")
with natural_kinds.publish(sensor, rows=rows, columns=columns, metres_per_count=metres_per_count) as shim:
    while True:
        loan = shim.borrow()  # its counts are a numpy array where readers will read them
        if device.readinto(loan.counts) < loan.counts.nbytes:
            break
        loan.send(command=forward)  # where the robot knows it
