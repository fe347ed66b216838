"""What pygeoapi asks for: a processor per tool, and a manager that hands jobs to the queue."""

from __future__ import annotations

import functools
import json
from pathlib import Path
from typing import Any

from pygeoapi.process.base import (
    BaseProcessor,
    JobNotFoundError,
    JobResultNotFoundError,
    ProcessorExecuteError,
)
from pygeoapi.process.manager.base import BaseManager
from pygeoapi.util import JobStatus, RequestedProcessExecutionMode

from toolbox import catalog
from toolbox.errors import ParameterError
from toolbox.server.jobs import DONE, FAILED, Full, Jobs, Limits
from toolbox.server.requests import Places, media_type, outputs_of, values_of

JSON = "application/json"


class ToolProcessor(BaseProcessor):  # type: ignore[misc]
    """The description of one tool; its jobs are run by the manager."""

    def __init__(self, processor_def: dict[str, Any]) -> None:
        super().__init__(processor_def, catalog.describe(processor_def["tool"]))
        self.supports_outputs = True


class Refused(ProcessorExecuteError):  # type: ignore[misc]
    """A request that cannot be run, in words that its sender may read."""

    def __init__(self, text: str, status: int = 400, code: str = "InvalidParameterValue") -> None:
        super().__init__(user_msg=text)
        self.http_status_code, self.ogc_exception_code = status, code


@functools.cache
def queue_of(folder: Path, limits: Limits) -> Jobs:
    """The one queue of a folder; pygeoapi makes a manager more than once."""
    return Jobs(folder, limits)


class JobManager(BaseManager):  # type: ignore[misc]
    """Jobs of pygeoapi in the queue of the toolbox."""

    def __init__(self, manager_def: dict[str, Any]) -> None:
        super().__init__(manager_def)
        self.is_async = True
        self.url = manager_def["url"]
        folder = Path(manager_def["jobs"])
        self.places = Places(Path(manager_def["data"]), folder, self.url)
        self.jobs = queue_of(folder, Limits(**manager_def["limits"]))

    def execute_process(
        self,
        process_id: str,
        data_dict: dict[str, Any],
        execution_mode: RequestedProcessExecutionMode | None = None,
        requested_outputs: Any = None,
        subscriber: Any = None,
        requested_response: Any = None,
    ) -> tuple[str, str, Any, JobStatus, dict[str, str]]:
        """Put a job into the queue; wait for it, unless the client asked not to."""
        if subscriber:
            raise Refused("subscribers are not called: this server calls nobody")
        described = catalog.describe(process_id)
        try:
            values = values_of(described, data_dict, self.places)
            files = outputs_of(described, requested_outputs or None)
            id = self.jobs.add(process_id, values, files)
        except ParameterError as err:
            raise Refused(str(err)) from None
        except Full as err:
            raise Refused(str(err), 503, "ServerBusy") from None
        if execution_mode == RequestedProcessExecutionMode.respond_async:
            told = self._accepted(id, process_id)
            return id, JSON, told, JobStatus.accepted, {"Preference-Applied": "respond-async"}
        job = self.jobs.wait(id)
        if job["status"] == DONE:
            return id, JSON, self._outputs(job), JobStatus.successful, {}
        problem = {"code": "InvalidParameterValue", "description": job["message"]}
        return id, JSON, problem, JobStatus.failed, {}

    def _accepted(self, id: str, process: str) -> dict[str, Any]:
        """What the standard asks for in the answer to a job that is done in the background."""
        monitor = {"rel": "monitor", "type": JSON, "href": f"{self.url}/jobs/{id}"}
        status = {"type": "process", "processID": process, "jobID": id, "status": "accepted"}
        return status | {"links": [monitor | {"title": "Status of the job"}]}

    def _outputs(self, job: dict[str, Any]) -> dict[str, Any]:
        """The outputs of a job: links to files, and values."""
        described = catalog.describe(job["process"])
        files = json.loads(job["request"])["files"]
        made: dict[str, Any] = {}
        for name, value in json.loads(job["result"]).items():
            if name in files:
                href = f"{self.url}/files/{job['id']}/{files[name]}"
                made[name] = {"href": href, "type": media_type(described, name)}
            elif not isinstance(value, dict):
                made[name] = value
        return made

    def file_of(self, id: str, name: str) -> Path | None:
        """A file that a job has given."""
        job = self.jobs.get(id)
        if job is None or job["status"] != DONE:
            return None
        given = json.loads(job["request"])["files"].values()
        path = self.jobs.folder / id / name
        return path if name in given and path.is_file() else None

    def get_jobs(self, status: Any = None, limit: Any = None, offset: Any = None) -> dict[str, Any]:
        """A page of the jobs, the newest first."""
        found = [self._shown(job) for job in reversed(self.jobs.all())]
        start = offset or 0
        page = found[start : start + limit] if limit else found[start:]
        return {"jobs": page, "numberMatched": len(found)}

    def get_job(self, job_id: str) -> dict[str, Any]:
        """A job as pygeoapi shows it."""
        job = self.jobs.get(job_id)
        if job is None:
            raise JobNotFoundError
        return self._shown(job)

    @staticmethod
    def _shown(job: dict[str, Any]) -> dict[str, Any]:
        times = {name: job[name] for name in ("created", "finished", "updated")}
        return times | {
            "identifier": job["id"],
            "process_id": job["process"],
            "status": job["status"],
            "message": job["message"],
            "progress": int(job["progress"]),
            "started": job["started"] or job["created"],
            "mimetype": JSON,
        }

    def get_job_result(self, job_id: str) -> tuple[str, Any]:
        """The outputs of a job that is done."""
        job = self.jobs.get(job_id)
        if job is None:
            raise JobNotFoundError
        if job["status"] != DONE:
            raise JobResultNotFoundError(job["message"] if job["status"] == FAILED else "")
        return JSON, self._outputs(job)

    def delete_job(self, job_id: str) -> bool:
        """Stop a job, or forget one that is over."""
        if not self.jobs.dismiss(job_id):
            raise JobNotFoundError
        return True
