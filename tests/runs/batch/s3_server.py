"""An S3 server in another process, for tests: moto's."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import threading
import urllib.request
from contextlib import contextmanager


@contextmanager
def s3_server():
    """Yield the environment in which a server is found that has a bucket named ``fleet``."""
    server = subprocess.Popen(
        [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", "0"],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        env=os.environ | {"PYTHONWARNINGS": "ignore"},
    )
    try:
        heard: list[str] = []
        for line in server.stderr:
            heard.append(line)
            found = re.search(r"http://127\.0\.0\.1:\d+", line)
            if found:
                break
        else:
            raise AssertionError("".join(heard))
        # its pipe must not fill up
        threading.Thread(target=server.stderr.read, daemon=True).start()
        put = urllib.request.Request(f"{found[0]}/fleet", method="PUT", data=b"")
        urllib.request.urlopen(put).close()
        yield {
            "AWS_ENDPOINT_URL": found[0],
            "AWS_ACCESS_KEY_ID": "test",
            "AWS_SECRET_ACCESS_KEY": "test",
            "AWS_REGION": "us-east-1",
        }
    finally:
        server.kill()
        server.wait()
        server.stderr.close()
