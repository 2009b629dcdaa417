"""Execution of many tasks in threads, on Dask or as shards: resumable, with bitwise identical results."""

from eclsim.execution.distribution import Distribution, Executor, Shard, ShardDone, as_executor, complete_in
from eclsim.execution.folder import ExecutionError, Format, TaskFolder, as_folder, digest_of_text, json_format
from eclsim.execution.tasks import Progress, TaskProgress, Tasks, announce, threads, using_threads

__all__ = [
    "Distribution", "ExecutionError", "Executor", "Format", "Progress", "Shard", "ShardDone", "TaskFolder",
    "TaskProgress", "Tasks", "announce", "as_executor", "as_folder", "complete_in", "digest_of_text",
    "json_format", "threads", "using_threads",
]  # fmt: skip
