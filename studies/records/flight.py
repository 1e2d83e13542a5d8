"""A flight in ULog and the same in DataFlash: how long a fitted model with its page takes.

    pip install numpy pyulog
    python studies/records/flight.py target/flight

Then, each in one command:

    fdm fit target/flight/roll.fdm --data target/flight/flight.ulg --map-file target/flight/px4.toml --report target/flight/px4.html
    fdm fit target/flight/roll.fdm --data target/flight/flight.bin --map-file target/flight/ardupilot.toml --report target/flight/ardupilot.html
"""

import struct
import sys
from pathlib import Path

import numpy as np
from pyulog import ULog

out = Path(sys.argv[1])
out.mkdir(parents=True, exist_ok=True)
SECONDS, RATE = 600, 250
LP, LU = -4.0, 30.0
rng = np.random.default_rng(3)
n = SECONDS * RATE
dt = 1 / RATE
# a command every 20 ms, steps of random length
steps = np.repeat(rng.choice([-1.0, 0.0, 1.0], size=SECONDS * 2), RATE // 2)[:n]
u = 0.1 * np.repeat(steps[:: RATE // 50], RATE // 50)
p, phi = np.zeros(n), np.zeros(n)
for k in range(n - 1):
    end = (p[k] + LU / LP * u[k]) * np.exp(LP * dt) - LU / LP * u[k]
    phi[k + 1] = phi[k] + (p[k] + end) / 2 * dt
    p[k + 1] = end
seen_p = p + rng.normal(0, 0.01, n)
seen_phi = np.angle(np.exp(1j * (phi + rng.normal(0, 0.005, n))))
quaternion = np.column_stack([np.cos(seen_phi / 2), np.sin(seen_phi / 2), np.zeros(n), np.zeros(n)])
micro = 5_000_000 + (np.arange(n) * 1_000_000) // RATE


def message(kind, body):
    return struct.pack("<HB", len(body), ord(kind)) + body


first = out / "first.ulg"
with open(first, "wb") as f:
    f.write(b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1000) + message("B", bytes(40)))
    f.write(message("F", b"vehicle_angular_velocity:uint64_t timestamp;float[3] xyz;"))
    f.write(message("F", b"vehicle_attitude:uint64_t timestamp;float[4] q;"))
    f.write(message("F", b"vehicle_torque_setpoint:uint64_t timestamp;float[3] xyz;"))
    for k, name in enumerate([b"vehicle_angular_velocity", b"vehicle_attitude", b"vehicle_torque_setpoint"]):
        f.write(message("A", struct.pack("<BH", 0, k) + name))
    for k in range(n):
        f.write(message("D", struct.pack("<HQ3f", 0, micro[k], seen_p[k], 0, 0)))
        if k % 5 == 0:
            f.write(message("D", struct.pack("<HQ4f", 1, micro[k] + 700, *quaternion[k])))
            f.write(message("D", struct.pack("<HQ3f", 2, micro[k], u[k], 0, 0)))
ULog(str(first)).write_ulog(str(out / "flight.ulg"))
first.unlink()


def form(kind, length, name, types, labels):
    return struct.pack("<3B", 0xA3, 0x95, 128) + struct.pack("<BB4s16s64s", kind, length, name, types, labels)


with open(out / "flight.bin", "wb") as f:
    f.write(form(128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns"))
    f.write(form(10, 23, b"IMU", b"Qfff", b"TimeUS,GyrX,GyrY,GyrZ"))
    f.write(form(11, 23, b"ATT", b"Qfff", b"TimeUS,Roll,Pitch,Yaw"))
    f.write(form(12, 13, b"RCOU", b"QH", b"TimeUS,C1"))
    for k in range(n):
        f.write(struct.pack("<3BQ3f", 0xA3, 0x95, 10, micro[k], seen_p[k], 0, 0))
        if k % 5 == 0:
            f.write(struct.pack("<3BQ3f", 0xA3, 0x95, 11, micro[k] + 700, np.degrees(seen_phi[k]), 0, 0))
            f.write(struct.pack("<3BQH", 0xA3, 0x95, 12, micro[k], round(1500 + 400 * u[k])))

(out / "roll.fdm").write_text("""model roll "roll of a small aircraft" {
  input  u_roll [1] "roll command";
  state  p = free [rad/s], phi = free [rad];
  param  Lp = -1 in [-50, 0] [1/s], Lu = 5 [1/s^2];
  der(p) = Lp*p + Lu*u_roll;
  der(phi) = p;
  output p_m [rad/s] = p, phi_m [rad] wrap 2*pi = phi;
}
""")
px4 = 'about = "roll alone"\n[time]\nrate = 50\n[channel.u_roll]\nfrom = "vehicle_torque_setpoint.xyz[0]"\nunit = "1"\nhold = true\n'
px4 += '[channel.p_m]\nfrom = "vehicle_angular_velocity.xyz[0]"\nunit = "rad/s"\n[channel.phi_m]\nfrom = "vehicle_attitude.roll"\nunit = "rad"\nwrap = 6.283185307179586\n'
(out / "px4.toml").write_text(px4)
ap = 'about = "roll alone"\n[time]\nrate = 50\n[channel.u_roll]\nfrom = "RCOU.C1"\nunit = "1"\nscale = 0.0025\noffset = -3.75\nhold = true\n'
ap += '[channel.p_m]\nfrom = "IMU.GyrX"\nunit = "rad/s"\n[channel.phi_m]\nfrom = "ATT.Roll"\nunit = "deg"\nwrap = 360\n'
(out / "ardupilot.toml").write_text(ap)
