"""Files of a web server, from any byte on where the server can do that (RFC 9110, ranges).

Who may read them is said in ``~/.netrc``, or by a value of the address's query that names a
variable of the environment. Neither is ever in a message: those of the library, which hold whole
addresses, are left out.
"""

import os
import re
from collections.abc import Iterator
from http import HTTPStatus

import requests
from urllib3.exceptions import HTTPError

from silmesh.errors import InputError
from silmesh.remote.download import PATIENCE, PIECE, Answer, BrokenOffError, Source

AGAIN = (408, 425, 429)  # statuses beside 5xx after which to ask again
GONE = (404, 410)
FORBIDDEN = (401, 403, 407)


def web_file(url: str) -> Source:
    """A file of a web server.

    Args:
        url: as the table has it; it is asked for with the variables of its query filled in
    """
    return lambda start, version: _ask(url, start, version)


def _ask(url: str, start: int, version: str) -> Answer:
    """Ask for the bytes from one on, of this version.

    Raises:
        InputError: the server has no such file, or not for us
        BrokenOffError: it does not answer, or says that it cannot now
    """
    headers = {"Accept-Encoding": "identity"}
    if start:
        headers |= {"Range": f"bytes={start}-", "If-Range": version}
    try:
        answer = requests.get(_fill_in(url), headers=headers, stream=True, timeout=PATIENCE)
    except requests.ConnectionError as error:
        raise BrokenOffError("the server cannot be reached") from error
    except requests.Timeout as error:
        raise BrokenOffError(f"the server says nothing for {PATIENCE} s") from error
    except requests.RequestException as error:
        raise InputError(f"{url}: cannot be asked for: {type(error).__name__}") from error
    if start and answer.status_code == HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE:
        if _total_of(answer) != start:  # what has come is more than there is
            return _ask(url, 0, "")
        return Answer(start, start, version, iter(()))
    _refuse_status(url, answer.status_code)
    ranged = re.match(r"bytes (\d+)-", answer.headers.get("Content-Range", ""))
    begins = int(ranged[1]) if answer.status_code == HTTPStatus.PARTIAL_CONTENT and ranged else 0
    if begins not in (0, start):
        raise BrokenOffError("the server gives other bytes than those asked for")
    return Answer(begins, _total_of(answer), _version_of(answer), _read(answer))


def _fill_in(url: str) -> str:
    """The address with the environment's values of the variables that its query names."""
    address, mark, query = url.partition("?")

    def value(found: re.Match[str]) -> str:
        if (given := os.environ.get(found[1])) is None:
            raise InputError(f"{url}: ${found[1]} is not set; should be a variable with the secret")
        return requests.utils.quote(given, safe="")

    return address + mark + re.sub(r"(?<==)\$(\w+)", value, query)


def _refuse_status(url: str, status: int) -> None:
    if status < 400:
        return
    said = f"{status} {requests.status_codes._codes.get(status, ('unknown',))[0].replace('_', ' ')}"
    if status >= 500 or status in AGAIN:
        raise BrokenOffError(f"the server says {said}")
    if status in FORBIDDEN:
        raise InputError(
            f"{url}: the server says {said}: credentials are missing or wrong; should be in "
            "~/.netrc, or in a variable that the address names: ?token=$MY_TOKEN"
        )
    if status in GONE:
        raise InputError(f"{url}: the server says {said}; should be an address that it has")
    raise InputError(f"{url}: the server says {said}")


def _total_of(answer: requests.Response) -> int | None:
    """Bytes of the whole file, where the server says so."""
    ranged = re.search(r"/(\d+)$", answer.headers.get("Content-Range", ""))
    length = answer.headers.get("Content-Length", "")
    if ranged:
        return int(ranged[1])
    return int(length) if length.isdecimal() and answer.status_code == HTTPStatus.OK else None


def _version_of(answer: requests.Response) -> str:
    """What a range may be made dependent on: a strong tag, else a date; "" if there is neither."""
    tag = answer.headers.get("ETag", "")
    strong = tag if tag.startswith('"') else ""
    return strong or answer.headers.get("Last-Modified", "")


def _read(answer: requests.Response) -> Iterator[bytes]:
    try:
        with answer:
            yield from answer.raw.stream(PIECE, decode_content=False)
    except (HTTPError, OSError) as error:
        raise BrokenOffError("the server broke off") from error
