"""Many clients send one submission with one Idempotency-Key at the same moment."""

import threading
from collections import Counter
from concurrent.futures import ThreadPoolExecutor

from support.service.stored_rows import add_recording
from support.service.web_server import Served

AT_ONCE = 12


def test_concurrent_submissions_with_one_key_are_one_job(service: Served) -> None:
    recording_id = service.run(add_recording(service.parts))
    together = threading.Barrier(AT_ONCE)

    def post(number: int) -> tuple[int, str]:
        body = {"recording_id": recording_id}
        if number % 4 == 3:  # somebody uses the key for something else
            body["method"] = "geometry"
        with service.http() as http:
            together.wait(30)
            answer = http.post("/api/v1/jobs/estimate-com", json=body, headers={"Idempotency-Key": "one"})
        reply = answer.json()
        return answer.status_code, str(reply.get("id", reply.get("code")))

    with ThreadPoolExecutor(AT_ONCE) as pool:
        answers = Counter(pool.map(post, range(AT_ONCE)))
    accepted = {answered: count for (status, answered), count in answers.items() if status == 202}
    refused = answers[409, "idempotency-key-reused"]
    assert len(accepted) == 1
    assert sum(accepted.values()) + refused == AT_ONCE
    assert refused in {AT_ONCE // 4, AT_ONCE - AT_ONCE // 4}  # the first request decides what the key is for
    with service.http() as http:
        listed = http.get("/api/v1/jobs", params={"recording_id": recording_id}).json()["items"]
    assert [job["id"] for job in listed] == list(accepted)
