"""A page of informed consent to begin with; what only the laboratory knows is in square brackets.

It has what the Declaration of Helsinki (2013, paragraph 26) and the GDPR (article 13) ask for: purpose, procedure,
storage, rights and contact. What it says of storage is what a session's log contains.
"""

from collections.abc import Mapping
from types import MappingProxyType

_TEXT = """\
Purpose: [what the study is about, in one or two sentences]. You will [what participants do]. It takes about [minutes] \
minutes. [Risks, if there are any; what you get for taking part.]

Storage: we store which keys you press and when, and your answers, under a code; no name and no address. From these \
times we also estimate whether a person or a program pressed the keys; a person decides what follows from it. [Where \
the data are, for how long, and who gets them.]

Your rights: taking part is voluntary. You may stop at any time, without a reason and without a disadvantage. Later, \
too, you may ask us to show, correct or delete your data, as long as we can find them by your code.

Contact: [name, institution, e-mail address]. Complaints: [ethics committee or data protection officer].
"""

CONSENT_PAGE: Mapping[str, str | bool] = MappingProxyType(
    {"title": "Consent", "text": _TEXT.strip(), "asks_consent": True}
)
