#!/usr/bin/env bash
# @MARK@. HyperQueue: a server and workers must be there (hq server start; hq worker start, or hq alloc add slurm).
# What is missing after a task or a worker was lost is submitted again.
set -uo pipefail
cd @FOLDER@
fdm=${FDM:-fdm}
for attempt in $(seq 100); do
    hq submit --wait --name @NAME@ --array 1-@SHARDS@ --cpus 1 --stdout none --stderr none -- \
        "$fdm" job run @PLAN@ --shard auto/@SHARDS@ --out @OUT@ --threads 1 --quiet
    "$fdm" job status @OUT@ --json | grep -q '"missing":\[\]' && break
done
"$fdm" job merge @OUT@
