#!/usr/bin/env bash
# @MARK@. Slurm: sbatch this file; then `fdm job merge` in its folder, or another job by sbatch --dependency=afterok:JOB.
#SBATCH --job-name=@NAME@
#SBATCH --array=1-@SHARDS@
#SBATCH --cpus-per-task=1
#SBATCH --requeue
#SBATCH --open-mode=append
#SBATCH --signal=B:TERM@60
cd @FOLDER@
fdm=${FDM:-fdm}
over=
# a minute before the time is over, or at a preemption: what is done is written, and the task is queued again
trap 'over=yes; kill -TERM "$work"' TERM
for attempt in $(seq 100); do
    "$fdm" job run @PLAN@ --shard auto/@SHARDS@ --out @OUT@ --threads "${SLURM_CPUS_PER_TASK:-1}" --quiet &
    work=$!
    wait "$work"
    code=$?
    if [ -n "$over" ]; then
        wait "$work"
        scontrol requeue "${SLURM_ARRAY_JOB_ID}_${SLURM_ARRAY_TASK_ID}"
        exit 1
    fi
    # beyond 128 a signal has ended the program, such as that for too much memory: what is missing is done by another
    if [ "$code" -le 128 ]; then
        exit "$code"
    fi
done
exit 1
