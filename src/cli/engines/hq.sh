#!/usr/bin/env bash
# @MARK@. HyperQueue: a server and workers must be there (hq server start; hq worker start, or hq alloc add slurm).
set -euo pipefail
cd @FOLDER@
fdm=${FDM:-fdm}
hq submit --wait --name @NAME@ --array 1-@SHARDS@ --cpus 1 --crash-limit 1000 --stdout none --stderr none -- \
    "$fdm" run @PLAN@ --shard auto/@SHARDS@ --out @OUT@ --threads 1 --quiet
"$fdm" merge @OUT@
