#!/usr/bin/env python3
"""One study and one fit from many starts, by every engine on this machine, with and without workers that are killed: whether the result
is that of the one command to the byte, and what the engine costs.

    cargo build --release && python/wheel
    studies/engines/prepare.sh
    target/engines/venv/bin/pip install target/wheels/fdm-*.whl
    target/engines/venv/bin/python studies/engines/engines.py

An engine is at work before the clock starts, as on a cluster, and `start` says how long that took. The time is that of the generated
script, merging included. Efficiency is the time of the command on one thread over twice the time of the engine: it counts on an idle machine
only. `busy` is the part of the time and of two cores that had a program at work on a shard, and processor seconds are those of every process
that the engine has started: both count on a busy machine too. Overhead is what these are beyond the command on one thread, for each task.
Kubernetes is a fake that does what an Indexed Job does.

The killer ends programs that work on a shard, and the workers of Dask and Ray themselves. Without the wheel, name the others by `--only`.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import os
import random
import resource
import secrets
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path

# Small, so that ten thousand repeats end in a minute: what an engine costs is seen beside tasks of 3 to 5 ms.
MODEL = """model decay "a rate, and what it ends at" {
  state x = 3;
  param k = 0.5 in [0.01, 10] [1/s], c = 0 in [-1, 1];
  der(x) = -k*x;
  output y = x + c;
}
"""

# Engines that stand before a job comes: each tells its address, and ends with its input.
SERVERS = {
    "hq": """import json, subprocess, sys
from hyperqueue import Job, LocalCluster
from hyperqueue.cluster import WorkerConfig

fdm, shards = sys.argv[1], int(sys.argv[2])
with LocalCluster() as cluster:
    cluster.start_worker(WorkerConfig(cores=2))
    client = cluster.client()
    print("ready here", flush=True)
    # the wheel has HyperQueue's server and workers, and its Python door in the place of the command `hq`: this is what the script does
    sys.stdin.readline()
    for attempt in range(100):
        job = Job(max_fails=None)
        for k in range(1, shards + 1):
            words = [fdm, "job", "run", "job.plan", "--shard", f"{k}/{shards}", "--out", "job.tasks", "--threads", "1", "--quiet"]
            job.program(words, stdout=None, stderr=None)
        client.wait_for_jobs([client.submit(job)], raise_on_error=False)
        status = subprocess.run([fdm, "job", "status", "job.tasks", "--json"], capture_output=True, text=True).stdout
        if not json.loads(status)["missing"]:
            break
    print("ready done", flush=True)
    sys.stdin.read()
""",
    "dask": """import sys
from dask.distributed import LocalCluster

if __name__ == "__main__":
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        print("ready", cluster.scheduler_address, flush=True)
        sys.stdin.read()
""",
    "ray": """import sys
import ray

ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
print("ready", ray.get_runtime_context().gcs_address, flush=True)
sys.stdin.read()
""",
}


def adopt() -> None:
    """Programs whose starter has ended become children of this one, so that their time is known."""
    subreaper = 36
    ctypes.CDLL(None).prctl(subreaper, 1, 0, 0, 0)


def descendants() -> dict[int, list[str]]:
    """All programs that stem from this one, with the fields of their state."""
    states: dict[int, list[str]] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                # the name may hold anything; what follows it begins with the state
                states[int(entry.name)] = (entry / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                pass
    own, found = {os.getpid()}, {}
    while own:
        young = {pid: fields for pid, fields in states.items() if int(fields[1]) in own}
        found.update(young)
        own = set(young)
    return found


def processor() -> float:
    """Processor seconds of all programs that this one has started, and of theirs."""
    ticks = sum(sum(map(int, fields[11:15])) for fields in descendants().values())
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    return ticks / os.sysconf("SC_CLK_TCK") + ended.ru_utime + ended.ru_stime


@dataclass
class Cost:
    """What one run has taken, in seconds."""

    elapsed: float
    processor: float
    start: float = 0.0
    busy: float = 1.0


def record(samples: int) -> str:
    """A record of the model, with a ripple that takes the place of noise."""
    from math import exp, sin

    rows = ["t [s],y"]
    for n in range(samples):
        t = 10.0 * n / samples
        rows.append(f"{t!r},{3.0 * exp(-0.7 * t) + 0.02 * sin(n * n + 0.4)!r}")
    return "\n".join(rows) + "\n"


class Watch(threading.Thread):
    """Looks how many programs work on shards of this folder, and kills one now and then."""

    LOOK = 0.2

    def __init__(self, folder: Path, pause: float, rng: random.Random):
        super().__init__(daemon=True)
        self.folder, self.pause, self.rng = str(folder), pause, rng
        self.kills, self.workers, self.over = 0, 0, threading.Event()
        self.seen: list[int] = []

    @property
    def busy(self) -> float:
        """The part of two cores that had a program at work."""
        return sum(min(n, 2) for n in self.seen) / max(2 * len(self.seen), 1)

    def run(self) -> None:
        due = self.next()
        while not self.over.wait(self.LOOK):
            shards, workers = self.processes()
            self.seen.append(len(shards))
            if self.pause and time.perf_counter() >= due:
                self.kill(shards, workers)
                due = self.next()

    def next(self) -> float:
        return time.perf_counter() + self.rng.uniform(0.5, 1.5) * self.pause

    def kill(self, shards: list[int], workers: list[int]) -> None:
        # every third time a worker, where the engine has some of its own
        worker = bool(workers) and self.rng.random() < 1 / 3
        victims = workers if worker else shards
        if victims:
            try:
                os.kill(self.rng.choice(victims), signal.SIGKILL)
                self.kills += 1
                self.workers += worker
            except ProcessLookupError:
                pass

    def processes(self) -> tuple[list[int], list[int]]:
        """Programs that do a shard in this folder, and workers of Dask and Ray that have started one. A worker that only begins is let be:
        after such kills Dask stood there without workers, and the job waited for new ones."""
        shards, workers = [], []
        running = descendants()
        for pid, fields in running.items():
            words = self.words(pid)
            if b"run" not in words[:5] or b"--shard" not in words or self.folder.encode() not in self.place(pid) + b" ".join(words):
                continue
            if any(word.endswith((b"mpirun", b"parallel", b"hq", b"perl", b"bash")) for word in words[:2]):
                continue
            shards.append(pid)
            parent = int(fields[1])
            text = b" ".join(self.words(parent)) if parent in running else b""
            if text.startswith(b"ray::") or b"spawn_main" in text:
                workers.append(parent)
        return shards, workers

    @staticmethod
    def words(pid: int) -> list[bytes]:
        try:
            return Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
        except OSError:
            return []

    @staticmethod
    def place(pid: int) -> bytes:
        try:
            return os.fsencode(os.readlink(f"/proc/{pid}/cwd"))
        except OSError:
            return b""


class Study:
    def __init__(self, options: argparse.Namespace):
        self.options = options
        self.fdm = Path(options.fdm).absolute()
        self.engines = Path(options.engines).absolute()
        self.work = Path(options.work).absolute()
        if not options.resume:
            shutil.rmtree(self.work, ignore_errors=True)
        self.work.mkdir(parents=True, exist_ok=True)
        (self.work / "decay.fdm").write_text(MODEL)
        (self.work / "run.csv").write_text(record(options.samples))
        root = self.engines / "root"
        paths = [root / "usr/bin", root / "usr/sbin", self.engines / "venv/bin"]
        machine = root / "usr/lib/x86_64-linux-gnu"
        libraries = [machine, machine / "slurm-wlm", root / "lib/x86_64-linux-gnu"]
        self.environment = {
            **os.environ,
            "FDM": str(self.fdm),
            "PATH": os.pathsep.join([*map(str, paths), os.environ["PATH"]]),
            "LD_LIBRARY_PATH": os.pathsep.join(map(str, libraries)),
            "OPAL_PREFIX": str(root / "usr"),
            "OPAL_LIBDIR": str(machine),
            "OPAL_PKGLIBDIR": str(machine / "openmpi"),
            "OPAL_DATADIR": str(root / "usr/share"),
            "OPAL_PKGDATADIR": str(root / "usr/share/openmpi"),
            "OPAL_SYSCONFDIR": str(root / "etc"),
            "OMPI_MCA_mca_base_component_path": str(machine / "openmpi/lib/openmpi3"),
            "OMPI_ALLOW_RUN_AS_ROOT": "1",
            "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
            "PERL5LIB": str(root / "usr/share/perl5"),
            "JOBS": "2",
            "RANKS": "2",
            "RAY_DEDUP_LOGS": "0",
            # its workers stand back behind everything else, at 15, unless they are told otherwise
            "RAY_worker_niceness": "0",
            # what a cluster of Ray asks of those who come to it
            "RAY_AUTH_MODE": "token",
            "RAY_AUTH_TOKEN": secrets.token_hex(32),
        }

    def call(self, words: list[str], where: Path, check: bool = True) -> subprocess.CompletedProcess[str]:
        done = subprocess.run(words, cwd=where, env=self.environment, capture_output=True, text=True, check=False)
        if check and done.returncode not in (0, 1):
            raise RuntimeError(f"{' '.join(words)}: {done.returncode}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}")
        return done

    def started(self, words: list[str], where: Path, name: str) -> subprocess.Popen[bytes]:
        log = open(where / f"{name}.log", "wb")
        return subprocess.Popen(words, cwd=where, env=self.environment, stdout=log, stderr=log)

    # --- engines: each does the script that `fdm job plan --for` has written ---

    def script(self, where: Path, engine: str) -> None:
        done = self.call(["bash", f"job.{engine}.sh"], where)
        (where / "engine.log").write_text(done.stdout[-4000:] + done.stderr[-4000:])

    @contextmanager
    def served(self, where: Path, engine: str, *words: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
        """An engine that stands, and its address."""
        (where / "server.py").write_text(SERVERS[engine])
        pipe = subprocess.PIPE
        with open(where / "server.log", "wb") as log:
            command = [str(self.engines / "venv/bin/python"), "server.py", *words]
            server = subprocess.Popen(command, cwd=where, env=self.environment, stdin=pipe, stdout=pipe, stderr=log, text=True)
        try:
            yield server, self.said(server)
        finally:
            assert server.stdin is not None
            server.stdin.close()
            server.wait()

    def said(self, server: subprocess.Popen[str]) -> str:
        """What an engine tells next; it may print other lines too."""
        assert server.stdout is not None
        for line in server.stdout:
            if line.startswith("ready "):
                return line.split()[1]
        raise RuntimeError("the engine has ended: see server.log")

    @contextmanager
    def parallel(self, where: Path) -> Iterator[Callable[[], None]]:
        yield lambda: self.script(where, "parallel")

    @contextmanager
    def mpi(self, where: Path) -> Iterator[Callable[[], None]]:
        self.environment["MPIRUN"] = "mpirun --oversubscribe --bind-to none --mca plm isolated --mca btl self,tcp"
        yield lambda: self.script(where, "mpi")

    @contextmanager
    def hq(self, where: Path) -> Iterator[Callable[[], None]]:
        with self.served(where, "hq", str(self.fdm), str(self.options.shards)) as (server, _):

            def go() -> None:
                assert server.stdin is not None
                server.stdin.write("go\n")
                server.stdin.flush()
                self.said(server)
                self.call([str(self.fdm), "job", "merge", "job.tasks"], where)

            yield go

    @contextmanager
    def slurm(self, where: Path) -> Iterator[Callable[[], None]]:
        host = os.uname().nodename.split(".")[0]
        lib = self.engines / "root/usr/lib/x86_64-linux-gnu/slurm-wlm"
        state = where / "slurm"
        state.mkdir()
        (state / "slurm.conf").write_text(
            f"ClusterName=here\nSlurmctldHost={host}(127.0.0.1)\nAuthType=auth/none\nCredType=cred/none\n"
            f"PluginDir={lib}\nSlurmUser=root\nSlurmdUser=root\nStateSaveLocation={state}\nSlurmdSpoolDir={state}/spool\n"
            f"SlurmctldPidFile={state}/ctld.pid\nSlurmdPidFile={state}/d.pid\nSlurmctldPort=16817\nSlurmdPort=16818\n"
            f"ProctrackType=proctrack/linuxproc\nTaskPlugin=task/none\nSelectType=select/cons_tres\nReturnToService=2\n"
            f"SlurmctldLogFile={state}/ctld.log\nSlurmdLogFile={state}/d.log\nMpiDefault=none\nSwitchType=switch/none\n"
            f"JobAcctGatherType=jobacct_gather/none\nAccountingStorageType=accounting_storage/none\nSchedulerType=sched/builtin\n"
            # without it an end is noticed up to three seconds later
            f"SchedulerParameters=batch_sched_delay=0\n"
            f"NodeName={host} NodeAddr=127.0.0.1 CPUs=2 State=UNKNOWN\nPartitionName=all Nodes={host} Default=YES State=UP\n"
        )
        self.environment["SLURM_CONF"] = str(state / "slurm.conf")
        control = self.started(["slurmctld", "-D", "-i"], where, "slurmctld")
        time.sleep(1.0)
        daemon = self.started(["slurmd", "-D", "-N", host, "-d", str(self.engines / "root/usr/sbin/slurmstepd")], where, "slurmd")
        try:
            for _ in range(100):
                if "idle" in self.call(["sinfo", "-h", "-o", "%t"], where, check=False).stdout:
                    break
                time.sleep(0.2)

            def go() -> None:
                done = self.call(["sbatch", "--wait", "job.slurm.sh"], where, check=False)
                (where / "engine.log").write_text(done.stdout + done.stderr)
                self.call([str(self.fdm), "job", "merge", "job.tasks"], where)

            yield go
        finally:
            for process in (daemon, control):
                process.terminate()
                process.wait()

    @contextmanager
    def dask(self, where: Path) -> Iterator[Callable[[], None]]:
        with self.served(where, "dask") as (_, address):
            yield lambda: self.python(where, "dask", address)

    @contextmanager
    def ray(self, where: Path) -> Iterator[Callable[[], None]]:
        with self.served(where, "ray") as (_, address):
            yield lambda: self.python(where, "ray", address)

    def python(self, where: Path, engine: str, address: str) -> None:
        done = self.call([str(self.engines / "venv/bin/python"), f"job.{engine}.py", address], where)
        (where / "engine.log").write_text(done.stdout[-4000:] + done.stderr[-4000:])

    @contextmanager
    def k8s(self, where: Path) -> Iterator[Callable[[], None]]:
        """A fake of what Kubernetes does with the Indexed Job: its command under each index, again after a failure unless that is 2."""
        text = (where / "job.k8s.yaml").read_text()
        words = json.loads(next(line for line in text.splitlines() if "command:" in line).split("command:")[1])
        count = int(next(line for line in text.splitlines() if "completions:" in line).split(":")[1])

        def pod(index: int) -> int:
            environment = {**self.environment, "JOB_COMPLETION_INDEX": str(index)}
            for _ in range(101):
                words_of_pod = [str(self.fdm), *words[1:]]
                code = subprocess.run(words_of_pod, cwd=where, env=environment, capture_output=True, check=False).returncode
                if code in (0, 2):
                    return code
            return 1

        def go() -> None:
            with ThreadPoolExecutor(2) as nodes:
                if any(nodes.map(pod, range(count))):
                    raise RuntimeError("an index has failed")
            self.call([str(self.fdm), "job", "merge", "job.tasks"], where)

        yield go

    # --- the table ---

    def job(self, kind: str) -> tuple[str, list[str], int]:
        if kind == "study":
            count = self.options.repeats
            return f"command = 'study'\nrepeats = {count}\nseed = 4\n", ["study", "--repeats", str(count), "--seed", "4"], count
        count = self.options.starts
        return f"command = 'fit'\nstarts = {count}\nseed = 3\n", ["fit", "--starts", str(count), "--seed", "3"], count

    def rows(self, kind: str) -> bool:
        _, words, count = self.job(kind)
        costs, results = {}, []
        for threads in (1, 2):
            out = self.work / f"{kind}-{threads}"
            kept = self.work / f"{kind}-{threads}.json"
            if not kept.exists():
                command = [str(self.fdm), words[0], "decay.fdm", "--data", "run.csv", *words[1:]]
                begun, spent = time.perf_counter(), processor()
                self.call([*command, "-q", "--threads", str(threads), "--out", str(out)], self.work)
                kept.write_text(json.dumps([time.perf_counter() - begun, processor() - spent]))
            costs[threads] = Cost(*json.loads(kept.read_text()))
            results.append((out / "result.json").read_bytes())
        same = results[0] == results[1]
        self.row(kind, "1 thread", count, costs[1], costs[1], "", same, cores=1)
        self.row(kind, "2 threads", count, costs[2], costs[1], "", same)
        for engine in self.options.only:
            for pause in self.options.kill:
                same &= self.one(kind, engine, pause, costs[1], results[0])
        return same

    def one(self, kind: str, engine: str, pause: float, alone: Cost, expected: bytes) -> bool:
        text, _, count = self.job(kind)
        where = self.work / f"{kind}-{engine}-{pause:g}"
        shutil.rmtree(where, ignore_errors=True)
        where.mkdir()
        for name in ("decay.fdm", "run.csv"):
            shutil.copy(self.work / name, where / name)
        (where / "job.toml").write_text(text + "model = 'decay.fdm'\ndata = 'run.csv'\nquiet = true\nout = 'merged'\n")
        python = engine in ("dask", "ray")
        program = [str(self.engines / "venv/bin/python"), "-m", "fdm"] if python else [str(self.fdm)]
        shards = str(self.options.shards)
        self.call([*program, "job", "plan", "job.toml", "-q", "--untimed", "--for", engine, "--shards", shards], where)
        watch = Watch(where, pause, random.Random(f"{kind} {engine}"))
        cost, result = Cost(0.0, 0.0), b""
        opened = time.perf_counter()
        try:
            standing: AbstractContextManager[Callable[[], None]] = getattr(self, engine)(where)
            with standing as go:
                begun, spent = time.perf_counter(), processor()
                watch.start()
                try:
                    go()
                finally:
                    watch.over.set()
                cost = Cost(time.perf_counter() - begun, processor() - spent, begun - opened, watch.busy)
            result = (where / "merged/result.json").read_bytes()
        except (RuntimeError, OSError) as e:
            print(f"{engine}: {e}", file=sys.stderr)
        workers = f" ({watch.workers} workers)" if watch.workers else ""
        same = result == expected
        self.row(kind, engine, count, cost, alone, f"{watch.kills} kills{workers}" if pause else "", same)
        return same

    def row(self, kind: str, engine: str, count: int, cost: Cost, alone: Cost, kills: str, same: bool, cores: int = 2) -> None:
        if cost.elapsed == 0.0:
            print(f"{kind:6} {engine:9} {count:6} was not done  {kills}", flush=True)
            return
        overhead = 1e3 * (cost.processor - alone.processor) / count
        efficiency = alone.elapsed / (cores * cost.elapsed)
        print(
            f"{kind:6} {engine:9} {count:6} start {cost.start:5.1f} s  {cost.elapsed:7.1f} s  efficiency {efficiency:5.3f}  busy {cost.busy:5.3f}"
            f"  processor {cost.processor:7.1f} s  overhead {overhead:7.3f} ms a task  {'the same bytes' if same else 'OTHER BYTES'}  {kills}",
            flush=True,
        )


def main() -> int:
    engines = ["parallel", "slurm", "hq", "dask", "ray", "mpi", "k8s"]
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--fdm", default="target/release/fdm")
    parser.add_argument("--engines", default=os.environ.get("FDM_ENGINES", "target/engines"))
    parser.add_argument("--work", default="target/engines/work")
    parser.add_argument("--repeats", type=int, default=10_000)
    parser.add_argument("--starts", type=int, default=2_000)
    parser.add_argument("--samples", type=int, default=25)
    parser.add_argument("--shards", type=int, default=20)
    parser.add_argument("--kill", nargs="+", type=float, default=[0.0, 3.0], help="seconds between kills on the average; 0: none")
    parser.add_argument("--resume", action="store_true", help="keep the results of the one command that are in --work")
    parser.add_argument("--only", nargs="+", choices=engines, default=engines)
    parser.add_argument("--kinds", nargs="+", choices=["study", "starts"], default=["study", "starts"])
    options = parser.parse_args()
    adopt()
    study = Study(options)
    found = [study.rows(kind) for kind in options.kinds]
    return 0 if all(found) else 1


if __name__ == "__main__":
    sys.exit(main())
