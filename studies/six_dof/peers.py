"""W7 of the benchmarks by two peers: an aircraft in six degrees of freedom, its response and exact sensitivities.

    python studies/six_dof/peers.py FOLDER

13 states, 40 parameters, 10,000 samples of one Runge-Kutta step, on one core. Equations, values and inputs are read from
`benches/peers/aircraft.rs`, so that all tools compute the same flight: `cargo bench -- w7` prints the same two figures of the last sample.
CasADi's step advances states and sensitivities together, as C that gcc compiles for this processor (minutes); JAX takes `jacfwd` of a scan.
Needs casadi, jax and NumPy from the Python index, and gcc. Times are of the process, in milliseconds.
"""

import ctypes
import math
import os
import pathlib
import re
import statistics
import subprocess
import sys
import time

os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"

import numpy as np

SOURCE = pathlib.Path(__file__).parents[2] / "benches/peers/aircraft.rs"
SAMPLES, STEP = 10_000, 0.005
WATCHED = ("u", "cma")


class Aircraft:
    """The text of the benchmark, as names, values and Python's expressions."""

    def __init__(self, text):
        text = text.split('const MODEL: &str = "')[1].split('";')[0]
        lines = [line.strip() for line in text.splitlines()]
        listed = lambda word: [
            item.strip() for line in lines if line.startswith(word + " ") for item in line[len(word) : -1].split(",")
        ]
        values = lambda word: {name: float(value) for name, value in (item.split(" = ") for item in listed(word))}
        equations = lambda left: re.findall(left + r" = (.*);", "\n".join(lines).replace("^", "**"))
        self.inputs, self.start, self.theta = listed("input"), values("state"), values("param")
        self.lets, self.rates = equations(r"let (\w+)"), dict(equations(r"der\((\w+)\)"))
        assert (len(self.start), len(self.theta), len(self.rates)) == (13, 40, 13)

    def derivatives(self, x, u, theta, functions):
        """The thirteen rates, in whatever arithmetic `x`, `u`, `theta` and the functions have."""
        names = dict(functions) | dict(zip(self.start, x)) | dict(zip(self.inputs, u)) | dict(zip(self.theta, theta))
        for name, text in self.lets:
            names[name] = eval(text, {}, names)
        return [eval(self.rates[state], {}, names) for state in self.start]


def controls():
    """Elevator, ailerons, rudder and throttle at every sample, SAMPLES x 4; the same sums as in the benchmark."""
    swept = lambda t, a, f, b, g: a * math.sin(f * t) + b * math.sin(g * t)
    return np.array([
        [swept(t, 0.03, 0.9, 0.02, 3.1), swept(t, 0.02, 1.3, 0.01, 2.7), swept(t, 0.03, 0.7, 0.02, 2.2), 0.5 + swept(t, 0.1, 0.2, 0, 0)]
        for t in (STEP * k for k in range(SAMPLES))
    ])


def runge_kutta(f, x, a, b):
    """One classical step with inputs linear in between; `x` may be a tuple that advances together."""
    middle = (a + b) / 2
    moved = lambda h, k: tuple(p + h * q for p, q in zip(x, k))
    k1 = f(x, a)
    k2 = f(moved(STEP / 2, k1), middle)
    k3 = f(moved(STEP / 2, k2), middle)
    k4 = f(moved(STEP, k3), b)
    return tuple(p + STEP / 6 * (q + 2 * r + 2 * s + t) for p, q, r, s, t in zip(x, k1, k2, k3, k4))


def timed(what, evaluate, repeats):
    """Prints median and least of `evaluate`, which returns the last sample's watched output and its derivative."""
    evaluate()
    times = []
    for _ in range(repeats):
        begun = time.process_time()
        last = evaluate()
        times.append(1e3 * (time.process_time() - begun))
    print(f"{what:32} median {statistics.median(times):7.1f} ms, least {min(times):7.1f} ms; at the end %.12e, by {WATCHED[1]} %.12e" % last)


DRIVE = """
#include <string.h>
int augmented(const double **arg, double **res, long long *iw, double *w, int mem);
void drive(int n, const double *x0, const double *u, const double *theta, double *x, double *s, long long *iw, double *w) {
  const double *arg[64]; double *res[64];
  memcpy(x, x0, 13 * 8); memset(s, 0, 520 * 8);
  for (int k = 0; k + 1 < n; k++) {
    arg[0] = x + 13 * k; arg[1] = s + 520 * k; arg[2] = u + 4 * k; arg[3] = u + 4 * (k + 1); arg[4] = theta;
    res[0] = x + 13 * (k + 1); res[1] = s + 520 * (k + 1);
    augmented(arg, res, iw, w, 0);
  }
}
"""


def by_casadi(aircraft, folder):
    import casadi as ca

    x, s, theta = ca.SX.sym("x", 13), ca.SX.sym("s", 13, 40), ca.SX.sym("theta", 40)
    a, b = ca.SX.sym("a", 4), ca.SX.sym("b", 4)
    at, given = ca.SX.sym("at", 13), ca.SX.sym("given", 4)
    functions = {"sqrt": ca.sqrt, "atan": ca.atan}
    rates = ca.vertcat(*aircraft.derivatives(ca.vertsplit(at), ca.vertsplit(given), ca.vertsplit(theta), functions))
    parts = ca.Function("parts", [at, given, theta], [rates, ca.jacobian(rates, at), ca.jacobian(rates, theta)])

    def together(pair, u):
        f, by_state, by_theta = parts(pair[0], u, theta)
        return f, by_state @ pair[1] + by_theta

    step = ca.Function("augmented", [x, s, a, b, theta], list(runge_kutta(together, (x, s), a, b)))
    here = os.getcwd()
    os.chdir(folder)
    step.generate("augmented.c")
    pathlib.Path("drive.c").write_text(DRIVE)
    command = "gcc -O3 -march=native -fno-math-errno -shared -fPIC augmented.c drive.c -o drive.so".split()
    begun = time.time()
    subprocess.run(command, check=True)
    print(f"CasADi's C: {step.n_instructions()} instructions, compiled in {time.time() - begun:.0f} s")
    library = ctypes.CDLL("./drive.so")
    os.chdir(here)
    sizes = [ctypes.c_longlong() for _ in range(4)]
    library.augmented_work(*[ctypes.byref(size) for size in sizes])
    work, indices = np.zeros(sizes[3].value + 8), np.zeros(sizes[2].value + 8, dtype=np.int64)
    u, y, tangents = controls(), np.zeros((SAMPLES, 13)), np.zeros((SAMPLES, 40, 13))
    x0, values = np.array(list(aircraft.start.values())), np.array(list(aircraft.theta.values()))
    pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in (x0, u, values, y, tangents, indices, work)]
    output, column = list(aircraft.start).index(WATCHED[0]), list(aircraft.theta).index(WATCHED[1])

    def evaluate():
        library.drive(SAMPLES, *pointers)
        return y[-1, output], tangents[-1, column, output]

    timed("CasADi, generated C", evaluate, 15)


def by_jax(aircraft):
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    u, x0, values = jnp.array(controls()), jnp.array(list(aircraft.start.values())), jnp.array(list(aircraft.theta.values()))
    functions = {"sqrt": jnp.sqrt, "atan": jnp.arctan}

    def response(theta):
        def step(x, ends):
            rates = lambda x, u: (jnp.stack(aircraft.derivatives(list(x[0]), list(u), list(theta), functions)),)
            (x,) = runge_kutta(rates, (x,), *ends)
            return x, x

        return jax.lax.scan(step, x0, (u[:-1], u[1:]))[1]

    both = jax.jit(lambda theta: (response(theta), jax.jacfwd(response)(theta)))
    begun = time.time()
    both(values)[1].block_until_ready()
    print(f"JAX: compiled and run once in {time.time() - begun:.0f} s")
    output, column = list(aircraft.start).index(WATCHED[0]), list(aircraft.theta).index(WATCHED[1])

    def evaluate():
        y, tangents = both(values)
        tangents.block_until_ready()
        return float(y[-1, output]), float(tangents[-1, output, column])

    timed("JAX, jacfwd of scan", evaluate, 7)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    place = pathlib.Path(sys.argv[1])
    place.mkdir(parents=True, exist_ok=True)
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    aircraft = Aircraft(SOURCE.read_text())
    by_casadi(aircraft, place)
    by_jax(aircraft)
