"""Vehicles on a link: transports, the session, what is requested, and the recording. The only sockets."""

from companion.links.link import Link, open_port
from companion.links.recordings import Recorder, play
from companion.links.request_table import Choice, RequestState
from companion.links.requests import ForbiddenMessageError, Request, Target, announce
from companion.links.restoration import state_folder
from companion.links.session import Report, Session
from companion.links.stream_manager import StreamManager
from companion.links.transports import Address, NotThereError, Port, is_link, meant_link, parse_address
from companion.links.vehicles import Clock
