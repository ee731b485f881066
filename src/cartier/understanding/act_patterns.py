"""Wordings that speak for an emergency, or against one: idioms, stories, kitchens and small hurts.

None decides alone: each is one input of the classifier beside the encoder's view (``act_classifier.py``), which weighs
them as fitted. They are searched in the words of a text without punctuation: "don't" is "don t".
"""

from __future__ import annotations

import re

from cartier.labels import plain, words

FAMILY = (
    r"(?:aunt|babies|baby|boss|boy|boyfriend|brother|carer|cat|child|children|dad|daddy|dog|everybody|everyone|ex"
    r"|family|father|flatmate|friend|girl|girlfriend|grand\w+|grandma|grandpa|granny|husband|infant|kids?|kitten|lodger"
    r"|man|men|mom|mommy|mother|mum|mummy|neighbou?rs?|papa|parents|people|person|roommate|sister|somebody|someone|son"
    r"|daughter|stepdad|teacher|toddler|twins|uncle|wife|woman)"
)
PERSON = rf"(?:him|her|them|he|she|they|(?:(?:my|the|our|a|your|that|little|old) )+{FAMILY}|{FAMILY}|opa|oma)"
HAZARD = (
    r"(?:axe|balcony|batter\w+|belt|blades?|bleach|bottles?|chainsaw|cigarettes?|cleaner|cleaning|detergent|drill"
    r"|dryer|electric\w*|fire|fireworks?|firecrackers?|glue|gun|hammer|iron|knife|knives|lighter|match|matches"
    r"|medicine|oven|petrol|pills?|plug|pods|poison|railing|razors?|roof|rope|saw|scissors|socket|stove|syrup|tablets"
    r"|tools|vodka|washing machine|window|wine|wire|plastic bag|pool|road|street)"
)
YOUNG = (
    r"(?:\b(?:i am|i m|im|me) (?:only |just |a |almost )*(?:two|three|four|five|six|seven|eight|nine|ten|eleven|[2-9]"
    r"|1[0-2])\b(?! (?:\w+ )?(?:minutes|hours|kilos|pounds|days|months|weeks))|\byears? old\b|\byear old\b|preschool"
    r"|kindergarten|first grade|\b(?:little|small) (?:boy|girl|kid)\b|\bi m (?:a kid|little|small|just little)\b)"
)
MINDER = r"\b(?:mommy|mummy|mama|daddy|papa|us kids|we kids)\b"
HARM = (
    r"(?:kill|hang|drown|shoot|stab|cut|hurt|harm|burn|choke|punish|poison|starve|strangle|slit|slash|murder|suffocate"
    r"|attack|smash|scratch|behead|set)"
)
HURT_THEM = (
    r"(?:kill|stab|shoot|strangl|chok|poison|drown|suffocat|beat|hit|punch|hurt|attack|slap|threaten|smash|murder|knock"
    r"|ram|shak|hitt|burn|kick|bit|rap)"
)
NOT = r"(?:not|no|never|cannot|(?:can|don|doesn|isn|won|didn|couldn|aren|wouldn|hasn) t|dont|doesnt|cant|wont|isnt)"
PATTERNS: tuple[tuple[str, str], ...] = (
    ("harms oneself", rf"\b{HARM}\w* (?:\w+ )?(?:myself|me)\b(?! (?:for|if|when|with))"),
    ("cuts a body", r"\b(?:cut|slit|slash|slic|open|burn|scratch|stick|stab)\w* (?:\w+ )?(?:my|her"
     r"|his) (?:own )?(?:wrist"
     r"|arm|vein|throat|thigh|skin|leg|eye|belly|stomach|face)"),
    ("wrists and veins", r"\b(?:wrists?|veins?|noose|suicid\w*|kms|overdos\w*|goodbye letter)\b"),
    ("wants to die", r"\b(?:want\w*|wanna|like|love|rather|going|gonna|ready|wish\w*|about|only|just)"
     r"(?: \w+){0,3} (?:die|dead)\b(?! (?:of|for|tired|on|to))"),
    ("ends life", r"\b(?:end(?:ing)?|finish|take|taking) (?:it all|my (?:own )?life|my misery|everything|things|it$"
     r"|it now|it tonight)|\b(?:my|this|own|of) life\b"),
    ("not to live", rf"\b{NOT}(?: \w+){{0,4}} (?:live|living|alive|exist\w*|wake up|be here)\b"
     rf"|\btired of (?:living|life)"
     r"|reason(?: for me)? to live|stop existing|without me\b|better off|never wake|miss me|from this world"),
    ("jumps", r"\b(?:jump\w*|fall|throw myself|climb\w*|fly|leap)(?: \w+){0,2} (?:off|out|from|of|down)\b"),
    ("all the pills", r"\b(?:all|every|too many|whole|so many)(?: \w+){0,4} (?:pills?|tablets?|bottle|drops|medicine)\b"
     r"|\bpills?(?: \w+){0,5} (?:all|every one)\b"),
    ("hurts somebody", rf"\b{HURT_THEM}\w* (?:up )?(?:{PERSON})\b"),
    ("somebody hurts", rf"\b{PERSON} (?:is |s |are |has |was |just |always )*(?:{HURT_THEM}\w*ing|stabbed|shot|beats"
     r"|hits|touches|locked|raped)\b"),
    ("blood of somebody", r"\b(?:bleed\w*|blood)\b(?! (?:orange|pressure|sugar|stain|test))"),
    ("breaks in", r"\b(?:broken? into|breaking in\w*|break down|burglar\w*|intruder|stranger|robber|following"
     r"|trying to get in|somebody in the house|hiding)\b"),
    ("weapon", r"\b(?:gun|rifle|bomb|acid|axe|bat|shots|shooting|shot|weapon|pistol)\b"),
    ("wants to hurt", rf"\b(?:want|going|gonna|will|ll|like|could|wanna|let|help)\b(?: \w+){{0,4}} {HURT_THEM}"),
    ("revenge", r"\b(?:revenge|pay with|make (?:him|her|them) (?:suffer|bleed|pay)|body|want (?:him|her"
     r"|them) dead|lesson"
     r"|alive|voices)\b"),
    ("no breath", rf"\b(?:{NOT}|stopp?e?d?|hard to|trouble|difficulty)(?: \w+){{0,3}} (?:breath\w*|air)\b|\bno breath"),
    ("senseless", r"\b(?:unconscious|unresponsive|collapsed|faint\w*|passed out|seizures?|convuls\w*|stroke|no pulse"
     r"|heart attack|heartbeat|foaming|dying|is dead|s dead|stiff|lifeless|drooping|emergency)\b"),
    ("does not wake", rf"\b{NOT}(?: \w+){{0,3}} (?:wak\w+|respond\w*|answer\w*|react\w*|mov\w+|talk\w*|speak\w*|get up"
     r"|stand)\b"),
    ("fell", r"\b(?:fell|fallen|slipped|tripped|stepped|knocked over|tipped over|trapped|stuck|run over)\b"),
    ("chokes", r"\b(?:chok\w+|swell\w*|swollen|suffocat\w+|throat|drown\w*|turn\w* blue|lips|face down|under water)\b"),
    ("swallowed", r"\b(?:swallow\w*|drank|drunk|eaten|ate|bit into|took|taken|injected|drink|eat|sniff|mix\w*)"
     rf"(?: \w+){{0,5}} (?:{HAZARD}|coin|button|magnet|mushrooms|berries|chemical\w*|antifreeze|acid|drugs|potion)\b"),
    ("broken body", r"\b(?:leg|arm|hip|bone|wrist|knee|ankle|finger|thumb|head|skull|back|neck|chest|eyes?|hand|foot)"
     r"(?: \w+){0,3} (?:broken|off|bent|numb|hurts? so|badly|pain|sticking|facing|bleed\w*)\b"),
    ("severe", r"\b(?:badly|terribl[ey]|heavily|everywhere|severe\w*|won t stop|wont stop|can t stop|quickly"
     r"|quick|now)\b"),
    ("call for help", r"\b(?:ambulance|911|112|999|fire brigade|fire department|police|doctor quick\w*|help help"
     r"|please help|help me|need help|urgent\w*)\b|^help\b|\bhelp$"),
    ("in labour", r"\b(?:giving birth|waters? broke|baby s coming|is coming now|pregnant)\b"),
    ("on fire", r"\b(?:on fire|in flames|flames?|caught fire|catch fire|ablaze|alight|blazing|a fire\b|fire s\b"
     r"|set fire|burning down|burn\w* down|smoulder\w*|explo\w+|spark\w*)\b"),
    ("is burning", r"\b(?:is|s|are|it|started to|has|to) (?:\w+ )?(?:burn|burns|burning|smoking|melted|hissing)\b"),
    ("fire alone", r"^(?:help )?(?:fire ?)+(?:help)?$|\bburn(?:ing)? (?:help|burn)"),
    ("smoke", r"\bsmoke\b(?! (?:detector|break))|\bburnt?\b"),
    ("gas", r"\b(?:gas|monoxide|petrol|fumes|chemical)\b(?! (?:bill|station|grill))"),
    ("smells", r"\b(?:smell\w*|stink\w*|leak\w*|hiss\w*)\b"),
    ("flood", r"\b(?:flood\w*|burst|under water|pouring|rising|knees|through the ceiling|coming (?:in|through"
     r"|from))\b"),
    ("ruin", r"\b(?:earthquake|collaps\w+|tornado|lightning|crashed|explod\w+|falling down|come down|shaking|trapped"
     r"|surrounded)\b"),
    ("young", YOUNG),
    ("minder", MINDER),
    ("hazard", rf"\b{HAZARD}\b"),
    ("alone", r"\b(?:alone|by myself|on my own|all by|without (?:daddy|mommy|mom|dad)|is(?:n t)? (?:asleep|home"
     r"|out|in the"
     r" shower)|nobody s home|can t see|says no|never touch)\b"),
    ("small child", r"\b(?:baby|toddler|infant|little one|my son|my daughter|kid|child|boy|two year old)\b"),
    ("play", r"\b(?:play\w*|hide|taste|yummy|candy|sweets|climb\w*|juggle|challenge)\b"),
    ("murders", r"\b(?:kill|murder|stab|die|death|dead|suicide|hang)\b"),
    ("idiom", r"\b(?:dy(?:ing|e) (?:for|of|to|from|laugh\w*)|(?:kill|die|murder) (?:for|a|an|some|time)|killing me"
     r"|kill me|to death|dead (?:tired|on my)|in love|asleep|over my dead|hell|bloody|break a leg|burning (?:to|desire)"
     r"|burn some|hit the|party|killer|burnt out|like fire|drives me|my mouth)\b"),
    ("past", r"\b(?:yesterday|last (?:week|month|year|night|spring|summer|sunday)|ago|when i was|as a child"
     r"|once|used to"
     r"|in (?:19|20)\d\d|this morning|in march|on sunday|in the war|already|last)\b"),
    ("story", r"\b(?:film|movie|book|novel|game|level|story|chapter|console|controller|news|song|hero|villain"
     r"|play(?:station)"
     r"|zombies?|boss|dragon|paper|read|watch|scene|toy|video|theatre|series|show)\b"),
    ("small hurt", r"\b(?:a little|a bit|slightly|plaster|band aid|tissues?|scrap\w+|paper cut|lotion|cream"
     r"|fine now)\b"),
    ("food", r"\b(?:bread|onion|cake|tomato\w*|steak|turkey|pizza|curry|soup|pasta|tea|coffee|cook\w*|bak\w+|fry|fries"
     r"|potato\w*|egg\w*|chicken|fish|dinner|lunch|toast|rice|meat|roast|chili|onions|fruit|apple|cheese|slice)\b"),
    ("cosy fire", r"\b(?:candles?|fireplace|barbecue|grill|charcoal|campfire|birthday|logs|wood|firewood|light the)\b"),
    ("household work", r"\b(?:clean\w*|wash\w*|iron|laundry|homework|paper|draw|parcel|nail|shelf|hair|shave|soak|relax"
     r"|thread|craft\w*|paint|picture|sharpen\w*|fix|plants?|flowers?)\b"),
    ("where is", r"\b(?:where|bring|fetch|get me|find|i need|is there|show me|take me|please)\b"),
    ("toy", r"\b(?:teddy|doll\w*|toy|ball|blocks|cartoon\w*|draw)\b"),
)  # fmt: skip
COMPILED = tuple(re.compile(pattern) for _, pattern in PATTERNS)
TOGETHER = (
    ("young", "hazard"), ("young", "play"), ("minder", "hazard"), ("small child", "hazard"), ("play", "hazard"),
    ("smells", "gas"), ("smells", "smoke"), ("hazard", "alone"), ("young", "alone"), ("murders", "hazard"),
    ("fell", "does not wake"), ("fell", "blood of somebody"), ("is burning", "food"),
    ("wants to hurt", "hurts somebody"), ("hurts somebody", "hazard"), ("on fire", "story"), ("hazard", "food"),
    ("severe", "blood of somebody"),
    ("small child", "swallowed"), ("young", "swallowed"), ("fell", "broken body"), ("is burning", "cosy fire"),
)  # fmt: skip
WIDTH = len(PATTERNS) + len(TOGETHER)


def heard(text: str) -> list[float]:
    """For each pattern, and for each two that count together, 1 where the words match, else 0."""
    said = " ".join(words(plain(text)))
    hits = {name: bool(one.search(said)) for (name, _), one in zip(PATTERNS, COMPILED, strict=True)}
    return [float(v) for v in hits.values()] + [float(hits[a] and hits[b]) for a, b in TOGETHER]
