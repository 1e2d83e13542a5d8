#!/usr/bin/env bash
# @MARK@. MPI as a starter: every rank is a shard and talks to no other. The number of ranks may differ from one start to the next.
# A rank that is lost ends them all: they are started again, and what was done is not done again.
set -uo pipefail
cd @FOLDER@
fdm=${FDM:-fdm}
for attempt in $(seq 100); do
    # $MPIRUN: its options, or srun --mpi=pmix
    ${MPIRUN:-mpirun} -n "${RANKS:-@SHARDS@}" "$fdm" job run @PLAN@ --shard auto --out @OUT@ --threads 1 --quiet && break
done
"$fdm" job merge @OUT@
