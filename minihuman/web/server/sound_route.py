"""The sounds of a study as files for pages, by their digests."""

import asyncio
from functools import lru_cache

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from minihuman.experiment.plan.trials import list_protocol_sounds
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.experiment.sounds import PAGE_RATE_HZ, compute_digest, encode_wav, render_sound

_MAX_CACHED = 512  # encoded sounds


def build_sound_route(protocol: Protocol) -> Route:
    """Build the route that serves a study's sounds as WAV files; each is encoded on the first request for it."""
    contents = {compute_digest(content, protocol.files): content for content in list_protocol_sounds(protocol)}

    @lru_cache(maxsize=_MAX_CACHED)
    def encode(digest: str) -> bytes:
        return encode_wav(render_sound(contents[digest], protocol.files, PAGE_RATE_HZ), PAGE_RATE_HZ)

    async def send_sound(request: Request) -> Response:
        digest = request.path_params["digest"]
        if digest not in contents:
            return Response("", 404)
        return Response(await asyncio.to_thread(encode, digest), media_type="audio/wav")

    return Route("/sounds/{digest}", send_sound)
