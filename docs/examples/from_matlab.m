% The human wing from MATLAB: upload a recording, estimate, and draw the centre of mass with its band.
%
% Needs a running service (make serve) and walk.c3d in the current folder (01_simulate_a_walk.py writes one).
% A service with tokens: give weboptions 'HeaderFields', {'Authorization', 'Bearer ...'} and the message a
% matlab.net.http.HeaderField('Authorization', 'Bearer ...') in the place of [].

api = 'http://127.0.0.1:8000/api/v1';
options = weboptions('MediaType', 'application/json', 'Timeout', 90);

% webwrite sends no files; a form with a file is a message of matlab.net.http.
file = matlab.net.http.io.FileProvider('walk.c3d');
form = matlab.net.http.io.MultipartFormProvider('file', file, 'height_m', '1.71', 'sex', 'female');
message = matlab.net.http.RequestMessage('POST', [], form);
answer = send(message, [api '/recordings']);
if answer.StatusCode ~= matlab.net.http.StatusCode.Created
    error('stridelab:refused', '%s', string(answer.Body));
end
recording = answer.Body.Data;

task = struct('recording_id', recording.id, 'method', 'smoother');
job = webwrite([api '/jobs/estimate-com'], task, options);
while ismember(job.state, {'queued', 'running'})
    job = webread([api '/jobs/' job.id], 'wait', 30, options);
end
if ~strcmp(job.state, 'succeeded')
    error('stridelab:job', '%s', job.error.detail);
end

result = webread([api '/jobs/' job.id '/result'], options);
fprintf('%s, %.1f kg\n', result.summary.method, result.summary.mass_kg);
websave('com.csv', [api '/jobs/' job.id '/artifacts/com.csv'], options);
com = readtable('com.csv');
errorbar(com.time_s, com.z_m, com.sd_z_m);
