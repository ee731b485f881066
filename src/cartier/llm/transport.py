"""Transport of the SDK, limited to the one server that was named: no redirect, no endless answer, its own proxy."""

from __future__ import annotations

import os
import ssl
from collections.abc import Callable
from typing import Any
from urllib.parse import urljoin, urlsplit

import openai

from cartier.errors import ReasonerError, brief
from cartier.llm.client import without_credentials
from cartier.llm.network import Proxy

MAX_REPLY_BYTES = 2**20
KEPT_HEADERS = ("content-type", "retry-after")


class CutOff(ReasonerError):
    """A connection that ended in the middle of an answer."""


class OneServer(openai.DefaultHttpxClient):  # type: ignore[misc]
    """The SDK's transport, limited to the one server that the person named and to answers of bounded size."""

    def __init__(
        self, url: str, where: str, proxy: Proxy | None, timeout_s: float, brief: Callable[[object], str]
    ) -> None:
        """``where`` is the URL as it may be printed; ``brief`` makes one line, without the key, of what a server says.

        Raises ReasonerError if the environment names no certificates, and what the SDK raises for a bad proxy.
        """
        through = proxy.url if proxy else None
        over_tls = "https" in (urlsplit(url).scheme, urlsplit(through or "").scheme)
        super().__init__(
            follow_redirects=False, timeout=timeout_s, trust_env=False, proxy=through,
            verify=over_tls and _trusted(),  # to read all certificates of the machine takes longer than a request
        )  # fmt: skip
        self._where, self._brief = where, brief

    def send(self, request: Any, **options: Any) -> Any:
        """A completely read response. Raises ReasonerError for a redirect, a broken connection or an endless body."""
        response = super().send(request, **(options | {"stream": True, "follow_redirects": False}))
        try:
            if 300 <= response.status_code < 400:
                raise ReasonerError(self._leads_elsewhere(response))
            body = self._body(response)
        finally:
            response.close()
        headers = {name: response.headers[name] for name in KEPT_HEADERS if name in response.headers}
        return type(response)(response.status_code, headers=headers, content=body, request=request)

    def _body(self, response: Any) -> bytes:
        body = bytearray()
        try:
            for chunk in response.iter_bytes():
                body += chunk
                if len(body) > MAX_REPLY_BYTES:
                    raise ReasonerError(
                        f"{self._where} answered more than {MAX_REPLY_BYTES} bytes: is it a language model?"
                    )
        except Exception as error:  # httpx's, by whatever name this SDK imports it
            if isinstance(error, ReasonerError) or "Timeout" in type(error).__name__:
                raise
            raise CutOff(
                f"{self._where} broke off in the middle of its answer ({self._brief(error)}): ask again"
            ) from error
        return bytes(body)

    def _leads_elsewhere(self, response: Any) -> str:
        """The error for a redirect, which is not followed: words and list go to the named server only."""
        said = f"{self._where} answered {response.status_code}"
        try:
            target = urljoin(str(response.request.url), response.headers["location"])
            target = self._brief(without_credentials(target))
        except (KeyError, ValueError, ReasonerError):
            return f"{said}, which leads nowhere: is the base URL right?"
        base = target.removesuffix("/chat/completions")
        trusted = f"if you trust it, the base URL is {base}"
        return f"{said}: it sends the request on to {target}, which is not followed; {trusted}"


def _trusted() -> ssl.SSLContext | bool:
    """The certificates that the environment names; True for the SDK's own. Raises ReasonerError if there are none."""
    for variable, kind in (("SSL_CERT_FILE", "cafile"), ("SSL_CERT_DIR", "capath")):
        if path := os.environ.get(variable):
            try:
                return ssl.create_default_context(**{kind: path})  # type: ignore[arg-type]
            except OSError as error:
                raise ReasonerError(
                    f"{variable} names {brief(path, 80)}, where no certificates can be read ({brief(error.strerror)}): "
                    "mend or unset it"
                ) from error
    return True
